"""Parts of a record that are left out of a fit: the state is carried into them, and they show enough."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

import emsid
from emsid.blocks import Rational
from emsid.identification.task import Task
from emsid.identification.verdict import model_verdicts
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.parameters import Signal
from emsid.options import Options
from emsid.record.holding_back import FAIR, choice_and_headline, hold_back_records, parted, shares, unseen_part
from emsid.validation.comparison import as_fit

DT, POLE, NOISE = 0.01, 0.995, 0.3


def filtered(u, pole=POLE):
    return lfilter([0.0, 1 - pole], [1.0, -pole], u)


def slow(seed=0, samples=900, noise=NOISE):
    """A slow filter with so much noise that few samples hardly show its state."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1, 1, samples // 30 + 1), 30)[:samples]
    y = filtered(u)
    return emsid.Record(u, y + noise * np.std(y) * rng.standard_normal(samples), DT)


MODELS = {
    "cascade": emsid.Cascade((Rational([1 - POLE], [-POLE], 1),), name="exact"),
    "regression": emsid.fit(emsid.arx(na=2, nb=1), slow(1)).model,
    "output error": emsid.fit(emsid.arx(na=1, nb=1), slow(1), free_run=True).model,
}


@pytest.mark.parametrize("name", MODELS)
def test_a_run_over_the_rest_is_the_end_of_the_run_over_the_whole(name):
    record, model = slow(), MODELS[name]
    first, rest = record.split(0.6)
    second, last = rest.split(0.5)
    whole = model.simulate(record)
    for part, stop in ((rest, 900), (second, 720), (last, 900), (record.part(100, 300), 300)):
        run = model.simulate(part)
        np.testing.assert_allclose(run.output, whole.output[stop - len(part) : stop], atol=1e-5)
        assert run.counted.all()
    assert not first.before
    ahead = model.predict(rest).output
    np.testing.assert_allclose(ahead, model.predict(record).output[540:], atol=1e-12)


def test_the_state_of_a_slow_filter_is_carried_into_the_rest():
    """Begun anew from its first sample, the exact model is far off for long; carried, its error is the noise."""
    exact = emsid.fit(emsid.arx(na=1, nb=1), slow(noise=0.0)).model
    ratios = []
    for seed in range(12):
        record = slow(seed)
        noise = float(np.std(record.output[:, 0] - filtered(record.input[:, 0])))
        rest = record.split(0.7)[1]
        anew = emsid.Record(rest.input, rest.output, DT)
        errors = [emsid.compare(exact, each).rows[0].simulation_rmse for each in (rest, anew)]
        ratios.append(np.array(errors) / noise)
    carried, begun = np.mean(ratios, axis=0)
    assert carried == pytest.approx(1.0, abs=0.03)
    assert begun > 1.1


def test_an_unbalance_is_judged_at_the_angle_that_the_record_has_led_to():
    """A motor with a mass off its axis turns many times; the speed does not show the angle at which the rest begins."""
    values = {
        "motor_constant": 0.05,
        "rotor_inertia": 2.5e-4,
        "rotor_friction.coulomb": 6e-3,
        "voltage_dead_zone.half_width": 0.0,
    }
    values |= {"voltage_dead_zone.half_width": 0.0, "cogging.period": 2 * np.pi, "cogging.sine_1": 0.012}
    plant = emsid.plants.rigid_motor()
    plant = plant.with_values({name: value for name, value in values.items() if name in plant.handles})
    model = GreyBox(plant, (Signal.SPEED,))
    rng = np.random.default_rng(0)
    u = np.r_[np.zeros(5), np.repeat(rng.uniform(-8, 8, 20), 40)]
    y = model.simulate(u, dt=DT).output + 0.05 * rng.standard_normal((len(u), 1))
    rest = emsid.Record(u, y, DT, input_units="V", output_units="rad/s").split(0.7)[1]
    anew = emsid.Record(rest.input, rest.output, DT, input_units="V", output_units="rad/s")
    carried, begun = (emsid.compare(model, each).rows[0].simulation_rmse for each in (rest, anew))
    assert carried == pytest.approx(0.05, rel=0.1)
    assert begun > 10 * carried


def test_what_is_before_a_part_is_kept_only_while_it_fits():
    record = slow()
    rest = record.split(0.5)[1]
    assert len(rest.before[0]) == 450
    assert not record[450:].before
    assert rest[:100].before
    assert not rest[10:].before
    assert not rest.detrend().before
    assert not rest.lowpass(10.0).before
    np.testing.assert_allclose(rest.scale("u1", 2.0).before[0].input, 2 * record.input[:450])
    both = emsid.concatenate([record, rest])
    assert [each is None for each in both.before] == [True, False]
    assert both.segments[1].before[0] is rest.before[0]
    gone = np.zeros(450, dtype=bool)
    gone[100:120] = True
    kept = rest.mask(gone)
    assert [each is None for each in kept.before] == [False, True]
    assert not rest.mask(np.arange(450) < 5).before


def test_a_part_after_a_gap_is_run_on_from_the_gap():
    record = emsid.concatenate([slow(0), slow(1)])
    part = record.part(1000, 1500)
    assert len(part.before[0]) == 100
    across = record.part(600, 1200)
    assert [each and len(each) for each in across.before] == [600, None]
    np.testing.assert_array_equal(across.segments[0].before[0].input, record.input[:600])


def test_folds_know_what_is_before_them():
    first, *others = parted(slow(), 3)
    assert not first.before
    assert [len(each.before[0]) for each in others] == [300, 600]


def test_an_identification_has_the_numbers_of_a_comparison():
    """`identify` and ``compare(models, test)`` after ``train, test = record.split(…)`` run over the same samples."""
    record = slow(noise=0.1)
    result = emsid.identify(record, models="arx,output-error")
    test = record.split(0.7)[1]
    assert result.unseen.before
    for row in emsid.compare(result.on_unseen.fits, test).rows:
        (own,) = [each for each in result.on_unseen.rows if each.model == row.model]
        assert own.samples == len(test)
        assert own.simulation_rmse == row.simulation_rmse


# --- a part that shows enough ----------------------------------------------------------------------------------------


def moves(still=500, samples=1000, seed=0):
    """A drive that moves and then stands still, while its command is noise."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1, 1, samples // 20), 20) * (np.arange(samples) < samples - still)
    u = u + 1e-3 * rng.standard_normal(samples)
    return emsid.Record(u, filtered(u, 0.9) + 0.01 * rng.standard_normal(samples), DT, name="move")


def test_another_part_is_unseen_where_the_end_is_at_standstill():
    record = moves()
    assert shares(record, 700, 1000)[0] < FAIR
    first, stop = unseen_part(record, 0.3)
    assert stop < 1000
    assert shares(record, first, stop).min() >= FAIR
    train, test = hold_back_records([record], 0.3)
    assert (len(train), len(test)) == (700, 300)
    np.testing.assert_array_equal(test.output, record.output[first:stop])
    assert train.breaks == (first,)
    assert len(test.before[0]) == first
    assert unseen_part(moves(still=0), 0.3) == (700, 1000)
    assert unseen_part(moves(still=950), 0.3) == (700, 1000)  # nothing else is left to fit


def test_which_part_is_unseen_is_said():
    def found(record):
        task = Task.of(record, 0.3, ("arx",), Options(), None, {})
        return [finding.data for finding in task.findings(quick=False) if finding.code == "end-shows-little"]

    (said,) = found(moves())
    first, stop = unseen_part(moves(), 0.3)
    assert (said["first"], said["last"], said["moved"]) == (first, stop - 1, True)
    (other,) = found(moves(still=950))
    assert not other["moved"]
    assert not found(moves(still=0))


def test_no_model_below_zero_can_be_used():
    """A servo move with a stop at its end: every model that is called usable explains some of the unseen part."""
    result = emsid.identify(moves(still=400, samples=800), models="arx,output-error")
    assert result.chosen.model.name in ("arx", "output-error")
    for row, verdict in zip(result.on_unseen.rows, result.model_verdicts, strict=True):
        assert (verdict.code == "model-unusable") == (row.fit_percent <= 0)
    assert result.on_unseen.best.row.fit_percent > 80
    known, unseen = moves(still=0), moves(still=850, seed=2)
    wrong = as_fit(emsid.Cascade((Rational([0.15], [-0.9], 1),), name="wrong"))
    on_known, on_unseen = (emsid.compare(wrong, each) for each in (known, unseen[200:]))
    (verdict,) = model_verdicts(on_known, on_unseen, ())
    assert on_unseen.rows[0].fit_percent < 0
    assert verdict.code == "model-unusable"


def test_unseen_data_are_not_divided_where_a_half_shows_little():
    assert choice_and_headline(moves(still=0, samples=4000)) is not None
    assert choice_and_headline(moves(still=2500, samples=4000)) is None
