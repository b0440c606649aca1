"""What holds for every kind of model: one state machine, run sample by sample, in blocks or at once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import emsid
from emsid import (
    ChannelNames,
    Ending,
    Estimate,
    Fit,
    LinearAxis,
    ModelError,
    MotorPlant,
    Record,
    concatenate,
    load,
    save,
)
from emsid.estimation.estimates import Status
from emsid.findings import Finding
from emsid.io import load_model
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.static_maps import STATIC_MAPS
from emsid.models.free_run import RUNAWAY, begins_at_rest, begins_steady
from emsid.models.kinds import MODELS
from emsid.models.linear.state_space import run_in_place as run_states
from emsid.models.model import Model
from emsid.models.plants.cogging import Cogging
from emsid.models.plants.drive import Bridge, Drive, Hold
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.parameters import Signal
from emsid.models.plants.sensor import Sensor
from emsid.models.plants.state import HELD
from emsid.models.regression.narx import Narx
from emsid.models.regression.structures import arx
from emsid.plant import Friction, FrictionLaw, Measure, Motor
from emsid.plant.friction import LawParameter, friction_law
from emsid.plant.gaussian_stribeck import GaussianStribeck
from model_examples import ALL, DT, MAPS, inputs, measured

every_model = pytest.mark.parametrize("model", ALL.values(), ids=ALL.keys())


def test_every_kind_of_model_and_of_block_is_here() -> None:
    assert {type(model) for model in ALL.values()} == set(MODELS.values())
    assert {block.kind for block in MAPS.values()} | {"filter"} == {*STATIC_MAPS, "filter", "user"}
    assert all(isinstance(model, Model) for model in ALL.values())


def same(one: Any, other: Any) -> None:
    """Two states, arrays or tuples of them, are equal."""
    if isinstance(one, tuple):
        for a, b in zip(one, other, strict=True):
            same(a, b)
    else:
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12)


@every_model
def test_sample_by_sample_and_in_blocks_equals_at_once(model: Model) -> None:
    record = measured(model)
    start = model.initial(record, model.memory)
    driven = record.input[model.memory :]
    expected, end = model.run(start, driven)
    assert expected.shape == (len(driven), record.output.shape[1])

    state, single = start, []
    for u in driven:
        y, state = model.advance(state, u)
        single.append(y)
    np.testing.assert_allclose(single, expected, rtol=1e-12, atol=1e-12)
    same(state, end)

    state, blocks = start, []
    for part in np.split(driven, [1, 3, 20, 21]):
        y, state = model.run(state, part)
        blocks.append(y)
    np.testing.assert_allclose(np.concatenate(blocks), expected, rtol=1e-12, atol=1e-12)
    same(state, end)


def test_a_kernel_is_compiled_once_for_arrays_that_may_be_written_to_and_others() -> None:
    model = ALL["state space"]
    held = inputs()[:, None]
    held.flags.writeable = False
    start = model.initial(measured(model), model.memory)
    model.run(start, held)
    compiled = len(run_states.signatures)
    model.run(start, inputs()[:, None])
    assert len(run_states.signatures) == compiled > 0


@every_model
def test_a_run_does_not_change_its_initial_state(model: Model) -> None:
    start = model.at_rest(0.0, DT)
    first, _ = model.run(start, inputs()[:, None])
    again, _ = model.run(start, inputs()[:, None])
    np.testing.assert_array_equal(first, again)


@every_model
def test_a_free_run_is_the_start_and_then_inputs_only(model: Model) -> None:
    record, late = measured(model), model.latency
    run = model.simulate(record)
    outputs, _ = model.run(model.initial(record, model.memory), record.input[model.memory :])
    expected = outputs[late:]
    np.testing.assert_array_equal(run.output[model.memory : len(record) - late], expected)
    np.testing.assert_array_equal(run.output[: model.memory], record.output[: model.memory])
    assert run.counted.tolist() == [k >= model.memory for k in range(len(record))]
    assert run.diverged_at is None


@every_model
def test_a_segment_that_begins_at_rest_counts_whole(model: Model) -> None:
    """Whatever the model needs to find the state of one in motion, which is in the same record here."""
    u = np.concatenate([np.zeros(4), np.linspace(0.2, 1.0, 5), inputs()])
    y = model.simulate(u, dt=DT).output
    y[:4] = y[0]  # an interpolated input acts a little before it changes
    rest, moving = Record(u, y, DT), measured(model)
    run = model.simulate(concatenate([rest, moving]))
    assert run.counted.tolist() == [True] * len(u) + [k >= model.memory for k in range(len(moving))]
    np.testing.assert_allclose(run.output[: len(u)], y, atol=0.03 * np.std(y))
    assert model.predict(rest).counted.all()
    np.testing.assert_array_equal(model.simulate(rest, model.memory + 7).counted, True)


def test_only_what_is_seen_to_rest_counts_whole() -> None:
    u, y = np.zeros(40), np.zeros(40)
    u[6:], y[7:] = 1.0, np.linspace(0.1, 1.0, 33)
    assert begins_at_rest(Record(u, y, DT))
    assert begins_at_rest(Record(u, y + 0.3, DT)), "an offset of the sensor"
    assert not begins_at_rest(Record(u + 1, y, DT)), "something drives it already"
    assert not begins_at_rest(Record(u[4:], y[4:], DT)), "too short to be seen"
    assert not begins_at_rest(Record(u, y + 1e-9 * np.arange(40), DT)), "it moves"


def test_a_steady_state_is_seen_in_as_many_samples_as_start_a_model() -> None:
    u, y = np.ones(40), np.zeros(40)
    u[6:], y[7:] = 2.0, np.linspace(0.1, 1.0, 33)
    assert begins_steady(Record(u, y, DT), 6), "another neutral command"
    assert not begins_steady(Record(u, y, DT), 7), "the command changes"
    assert not begins_steady(Record(u[4:], y[4:], DT), 1), "too short to be seen"
    assert not begins_steady(Record(u, y + 1e-9 * np.arange(40), DT), 6), "it moves"
    assert not begins_steady(Record(u[:6], y[:6], DT), 7), "too short to start the model"
    assert not begins_steady(Record(u, np.roll(y, -2), DT), 5), "the command came before the record"
    assert not begins_steady(Record(np.ones(40), y, DT), 6), "the command came before the record and stays"


@every_model
def test_a_record_without_outputs_starts_at_rest(model: Model) -> None:
    u, late = inputs(), model.latency
    silent = Record(u, np.empty((len(u), 0)), DT)
    run = model.simulate(silent)
    expected, _ = model.run(model.at_rest(0.0, DT), u[:, None])
    np.testing.assert_array_equal(run.output[: len(u) - late], expected[late:])
    assert run.counted.all()
    assert model.simulate(silent, 10).counted.sum() == len(u) - 10
    for given in (u, u[:, None], u.tolist()):
        np.testing.assert_array_equal(model.simulate(given, dt=DT).output, run.output)


@every_model
def test_inputs_alone_take_the_sample_time_of_the_model(model: Model) -> None:
    if model.dt is None:
        with pytest.raises(ModelError, match="give that of the inputs"):
            model.simulate(inputs())
        with pytest.raises(ModelError, match="any sample time"):
            model.at_rest(0.0)
    else:
        np.testing.assert_array_equal(model.simulate(inputs()).output, model.simulate(inputs(), dt=DT).output)


@every_model
def test_at_rest_nothing_moves(model: Model) -> None:
    level = 0.0 if model.dt is None else 0.4
    outputs, _ = model.run(model.at_rest(level, DT), np.full((50, 1), level))
    ripple = 1e-6 if getattr(model, "oversampling", 1) > 1 else 1e-9  # the former is that of the interpolation
    np.testing.assert_allclose(outputs, np.broadcast_to(outputs[:1], outputs.shape), rtol=ripple, atol=ripple)


@every_model
def test_a_standstill_in_the_data_is_no_divergence(model: Model) -> None:
    record = measured(model)
    for level in (0.0, 1e-6):
        still = replace(record, output=np.full(record.output.shape, level))
        assert model.simulate(still).diverged_at is None


@every_model
def test_segments_run_as_they_do_alone(model: Model) -> None:
    pieces = measured(model, 1), measured(model, 2)
    runs = [model.simulate(piece) for piece in pieces]
    whole = model.simulate(concatenate(pieces))
    np.testing.assert_array_equal(whole.output, np.concatenate([run.output for run in runs]))
    np.testing.assert_array_equal(whole.counted, np.concatenate([run.counted for run in runs]))


@pytest.mark.parametrize("plant", [MotorPlant(replace(Motor(), inductance=0.0).rigid()), LinearAxis()])
@pytest.mark.parametrize("delay", [0.0, 1.4 * DT, 10 * DT])
@pytest.mark.parametrize("hold", list(Hold))
def test_plants_with_other_drives_and_sensors_run_at_once_as_sample_by_sample(
    plant: DrivenPlant, delay: float, hold: Hold
) -> None:
    rng = np.random.default_rng(4)
    u = rng.uniform(-12.0, 12.0, (40, 1))
    late = plant.with_drive(delay=delay, hold=hold)
    slow = late.with_values({"sensor.lag": DT, "sensor.average": 0.3, late.load_name: 0.02})
    signals = (Signal.POSITION, Signal.SPEED)
    for each in (late, slow, late.with_values({"cogging.sine_2": 0.01})):
        begin, own, single = (
            np.append(rng.uniform(-1.0, 1.0, HELD), rng.integers(2)),
            each.for_inputs(u),
            np.empty((40, 2)),
        )
        sampler = own.sampler(own.start(begin, u[0], DT, signals), signals)
        for row, y in zip(u, single, strict=True):
            sampler.advance(row, y)
        assert np.array_equal(single, each.simulate(u, DT, begin, signals))


@every_model
def test_a_model_with_a_sample_time_refuses_another(model: Model) -> None:
    record = measured(model)
    other = replace(record, dt=2 * DT, times=())
    for use in (model.simulate, model.predict):
        if model.dt is None:
            assert use(other).counted.any()
        else:
            with pytest.raises(ModelError, match=r"identified at 0.01 s and record is sampled every 0.02 s"):
                use(other)


@every_model
def test_a_prediction_is_no_worse_than_the_free_run(model: Model) -> None:
    record = measured(model)
    free, near, far = model.simulate(record), model.predict(record), model.predict(record, 10_000)
    counted = free.counted
    assert np.array_equal(near.counted, counted)
    np.testing.assert_allclose(far.output, free.output, rtol=1e-9, atol=1e-9)  # nothing measured reaches that far
    missed = [np.mean((run.output - record.output)[counted] ** 2) for run in (near, free)]
    assert missed[0] <= 4 * missed[1]  # the noise of one sample more


@every_model
def test_a_model_prints_as_its_equations(model: Model) -> None:
    assert str(model) == model.equation()


def test_a_cascade_saved_without_a_sample_time_is_read() -> None:
    data = ALL["hammerstein"].to_data()
    del data["dt"]
    model = Cascade.from_data(data)
    assert model.dt is None
    assert model.simulate(Record(inputs(), inputs(1), 0.5)).counted.any()


def test_a_run_that_leaves_all_bounds_is_cut_off_in_its_segment() -> None:
    model = Narx(arx(1, 1), np.array([-2.0, 1.0]), DT)
    record = Record(np.zeros(60), np.r_[1.0, 0.5 * np.ones(59)], DT)
    run = model.simulate(concatenate([record, record]))
    at = 1 + int(np.log2(RUNAWAY))
    assert run.diverged_at == at
    assert np.isnan(run.output[at:60]).all()
    assert np.isnan(run.output[60 + at :]).all()
    assert np.isfinite(run.output[:at]).all()
    assert np.isfinite(run.output[60 : 60 + at]).all()


def test_more_inputs_than_a_model_has_are_refused() -> None:
    with pytest.raises(ModelError, match="one number for each"):
        ALL["arx"].at_rest([1.0, 2.0])
    with pytest.raises(ModelError, match="one number for each"):
        ALL["hammerstein"].advance(ALL["hammerstein"].at_rest(), [1.0, 2.0])


# --- parameters by name, and files that carry a fit -------------------------------------------------------------------


@every_model
def test_parameters_are_given_by_name(model: Any) -> None:
    u, values = inputs(), model.parameter_values()
    same_again = model.with_parameters(**dict(list(values.items())[:2]))
    if same_again.parameter_values().keys() == values.keys():  # a form with states of every output has more
        np.testing.assert_allclose(list(same_again.parameter_values().values()), list(values.values()), atol=1e-12)
    expected = model.simulate(u, dt=DT).output
    scale = np.max(np.abs(expected))
    np.testing.assert_allclose(same_again.simulate(u, dt=DT).output, expected, rtol=1e-9, atol=1e-9 * scale)
    with pytest.raises(ModelError, match="has no parameter 'no_such'"):
        model.with_parameters(no_such=1.0)


@pytest.mark.parametrize("name", ["arx", "armax", "state space", "hammerstein", "feedback, dead-zone", "linear axis"])
def test_another_value_of_a_parameter_is_another_model(name: str) -> None:
    model: Any = ALL[name]
    values = model.parameter_values()
    key = "motor_constant" if name.endswith("motor") else next(n for n, v in values.items() if 0 < abs(v) < np.inf)
    other = model.with_parameters(**{key: 0.9 * values[key]})
    assert other.parameter_values()[key] == pytest.approx(0.9 * values[key])
    assert other.parameter_values().keys() == values.keys()


UNSAVED = ("user", "own plant")


def fitted(model: Any) -> Fit[Any]:
    """A fit of a model with a covariance, one undetermined parameter, findings and a table with units."""
    rng = np.random.default_rng(4)
    values = {name: value for name, value in model.parameter_values().items() if np.isfinite(value)}
    factor = rng.standard_normal((len(values), len(values)))
    covariance = factor @ factor.T + np.eye(len(values))
    covariance[-1, -1] = np.inf
    table = tuple(
        Estimate(name, "s", "kg*m^2", "what it is", value, 0.1, Status.CONDITIONAL, 1.0, None, ("a",), (-1.0, np.inf))
        for name, value in values.items()
    )
    found = Finding("parameter-at-bound", "a", {"bound": 1.0, "because": None, "names": ["a", "b"]})
    channels = ChannelNames(DT, (("voltage", "V"),), (("speed", "rad/s"),))
    return Fit(
        model, tuple(values), np.array(list(values.values())), covariance, 0.3, 100.0, np.inf, len(values) - 1,
        Ending.STALLED, "gn", 7, None, (found,), 1, table, channels,
    )  # fmt: skip


@every_model
def test_a_saved_fit_is_read_as_it_was_and_runs_the_same(
    model: Any, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    fit = fitted(model)
    if any(name in request.node.name for name in UNSAVED):
        for each in (fit, model):
            with pytest.raises(ModelError, match=r"cannot be saved|functions"):
                save(each, tmp_path / "fit.json")
        return
    for each in (fit, replace(fit, table=())):
        save(each, tmp_path / "fit.json")
        again: Any = load(tmp_path / "fit.json")
        assert type(again) is Fit
        for name in ("names", "noise_variance", "samples", "condition", "rank", "ending", "method", "iterations"):
            assert getattr(again, name) == getattr(each, name)
        assert (again.parameters, again.findings, again.dependent) == (each.parameters, each.findings, each.dependent)
        assert again.channels == each.channels
        np.testing.assert_array_equal(again.estimate, each.estimate)
        np.testing.assert_array_equal(again.covariance, each.covariance)
        np.testing.assert_array_equal(again.interval(), each.interval())
        assert (again.name, again.memory) == (model.name, model.memory)
    assert type(load_model(tmp_path / "fit.json")) is type(model)
    save(model, tmp_path / "model.json")
    alone, record = load(tmp_path / "model.json"), measured(model)
    assert (alone.dt, alone.memory, alone.latency) == (model.dt, model.memory, model.latency)
    expected = model.simulate(record).output
    for each in (again, alone):
        np.testing.assert_array_equal(each.simulate(record).output, expected)


def test_of_very_many_parameters_only_variances_are_saved(tmp_path: Path) -> None:
    many = 260
    model = Narx(arx(0, many), np.zeros(many), DT)
    covariance = np.full((many, many), 0.5) + np.eye(many)
    fit = Fit(model, model.structure.parameter_names, model.parameters, covariance, 1.0, 1e3, 1.0, many)
    save(fit, tmp_path / "fit.json")
    again: Any = load(tmp_path / "fit.json")
    np.testing.assert_array_equal(again.interval(), fit.interval())
    assert np.isnan(again.covariance[~np.eye(many, dtype=bool)]).all()


# --- sample by sample -------------------------------------------------------------------------------------------------


@every_model
def test_a_stepper_gives_the_numbers_of_a_run(model: Any) -> None:
    record = measured(model)
    expected, end = model.run(model.at_rest(0.0, DT), record.input)
    running = emsid.start(model, dt=DT)
    stepped = np.array([running.step(u[0]) for u in record.input]).reshape(expected.shape)
    np.testing.assert_allclose(stepped, expected, rtol=1e-9, atol=1e-9 * np.max(np.abs(expected)))
    following = inputs(7)[:20]
    ahead, _ = model.run(end, following[:, None])
    predicted = running.predict(following)
    np.testing.assert_allclose(predicted.reshape(ahead.shape), ahead, rtol=1e-9, atol=1e-9 * np.max(np.abs(ahead)))
    again = [running.step(u) for u in following]
    np.testing.assert_allclose(again, predicted, rtol=1e-9, atol=1e-9 * np.max(np.abs(ahead)))


@every_model
def test_a_stepper_begins_where_a_record_ends(model: Any) -> None:
    record, following = measured(model), inputs(7)[:20]
    expected, _ = model.run(model.initial(record, len(record)), following[:, None])
    running = emsid.start(model, record=record)
    stepped = np.array([running.step(u) for u in following]).reshape(expected.shape)
    np.testing.assert_allclose(stepped, expected, rtol=1e-9, atol=1e-9 * np.max(np.abs(expected)))


@pytest.mark.parametrize("name", ["arx", "paper's", "state space", "state space, two outputs", "armax"])
def test_measured_outputs_correct_a_stepper_to_the_one_step_prediction(name: str) -> None:
    model: Any = ALL[name]
    record = measured(model)
    start = model.memory
    running = emsid.start(model, record=record[:start])
    predicted = []
    for u, y in zip(record.input[start:, 0], record.output[start:], strict=True):
        predicted.append(np.atleast_1d(running.step(u)))
        running.correct(y)
    expected = model.predict(record).output[start:]
    np.testing.assert_allclose(predicted, expected, rtol=1e-9, atol=1e-9)


def test_what_a_stepper_cannot_do_is_answered() -> None:
    running = emsid.start(ALL["hammerstein"])
    running.step(1.0)
    with pytest.raises(ModelError, match="no model of its noise"):
        running.correct(1.0)
    with pytest.raises(ModelError, match="call step first"):
        emsid.start(ALL["arx"]).correct(1.0)
    with pytest.raises(ModelError, match="give 1 numbers, or one"):
        running.step([1.0, 2.0])
    with pytest.raises(ModelError, match="give 1 numbers"):
        running.step("3 V")
    with pytest.raises(ModelError, match="any sample time"):
        emsid.start(ALL["rigid motor"])


@pytest.mark.parametrize("hold", list(Hold))
@pytest.mark.parametrize("delay", [0.0, 0.4 * DT, 2.3 * DT])
@pytest.mark.parametrize("law", ["paper", "gaussian", "python"])
def test_a_stepper_of_a_motor_knows_drives_sensors_codes_and_laws(hold: Hold, delay: float, law: str) -> None:
    friction = {"paper": Friction(0.02, 0.01, 2.0), "gaussian": GaussianStribeck(0.02, 0.01, 2.0), "python": Slow(0.02)}
    motor = replace(Motor(), inductance=0.0, rotor_friction=friction[law], load_friction=Friction()).rigid()
    codes = () if hold is not Hold.ZERO else ((99.0, Bridge.BRAKE), (98.0, Bridge.COAST))
    drive = Drive(
        1.2, 0.1, 12.0, delay, knee=5.0, beyond=0.8, freewheel=0.5, codes=codes, hold=hold, loss=0.1, rise=0.1
    )  # fmt: skip
    sensor = Sensor(2.0, 2 * DT, 0.3, 0.4)
    plant = MotorPlant(motor, drive, sensor, 0.003, quadratic_viscous=1e-5, cogging=Cogging(1.0, 0.001, 0.002))
    model = GreyBox(plant, (Signal.SPEED, Signal.POSITION, Signal.CURRENT))
    u = 3.0 * inputs(5)
    if codes:
        u[40:60], u[70:90] = 99.0, 98.0
    expected, _ = model.run(model.at_rest(0.0, DT), u[:, None])
    running = emsid.start(model, dt=DT)
    np.testing.assert_allclose([running.step(each) for each in u], expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("hold", list(Hold))
@pytest.mark.parametrize("shaft", [1e-3, 50.0, 1e9])
def test_a_stepper_of_a_motor_with_a_shaft(hold: Hold, shaft: float) -> None:
    drive = Drive(delay=0.3 * DT, hold=hold, supply=9.0)
    plant = MotorPlant(replace(Motor(), shaft_stiffness=shaft), drive, Sensor(lag=DT), 0.002)
    model = GreyBox(plant, (Signal.SPEED, Signal.ROTOR_SPEED, Signal.POSITION, Signal.CURRENT))
    u = 3.0 * inputs(5)
    expected, _ = model.run(model.at_rest(0.0, DT), u[:, None])
    running = emsid.start(model, dt=DT)
    stepped = np.array([running.step(each) for each in u])
    np.testing.assert_allclose(stepped, expected, rtol=1e-6, atol=1e-7 * np.max(np.abs(expected)))


@friction_law("slow-for-tests")
@dataclass(frozen=True)
class Slow(FrictionLaw):
    """A level that is not compiled."""

    dry: float = 0.0
    parameters = (LawParameter("dry", "α₀", Measure.FORCE, "dry friction"),)
    level = staticmethod(lambda speed, numbers, side: numbers[side, 0])
