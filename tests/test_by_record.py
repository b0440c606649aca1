"""Parameters that differ by record: one motor that turns another load in every experiment."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import emsid
from emsid.errors import ModelError
from emsid.identification.result_format import checked
from emsid.models.plants.by_record import PlantByRecord
from emsid.models.plants.free_run_error import FreeRunError, all_alike
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.parameters import Signal
from emsid.plants import rigid_motor
from independent.settings import DT, RESISTANCE, TRUTH, mass_of
from simulated_plants import codes

LOADS = {"bare": 2e-4, "disc": 5e-4, "wheel": 1.6e-3}
KNOWN = {"resistance": RESISTANCE, "rotor_viscous": 0.0}
FREE = tuple(TRUTH)


def experiment(name, inertia, seed=0, samples=500, noise=0.3, **changes):
    """Levels held for a while, that the independent simulator turns into a speed with noise."""
    rng = np.random.default_rng([seed, *name.encode()])
    command = np.repeat(rng.uniform(-4, 4, samples // 25), 25)
    speed, _ = mass_of({**TRUTH, "rotor_inertia": inertia, **changes}).run(command, DT)
    shown = speed[:samples] + noise * rng.standard_normal(samples)
    return emsid.Record(command, shown, DT, input_units="V", output_units="rad/s", name=name)


def experiments(seed=0, **changes):
    return [experiment(name, inertia, seed, **changes) for name, inertia in LOADS.items()]


def by_record(records, **options):
    return emsid.fit(
        rigid_motor(),
        records,
        **{"free": FREE, "fixed": KNOWN, "per_record": "rotor_inertia", "search": False, **options},
    )


@pytest.fixture(scope="module")
def records():
    return experiments()


@pytest.fixture(scope="module")
def fit(records):
    return by_record(records)


def test_every_load_is_recovered_with_one_motor(fit):
    found = dict(zip(fit.names, fit.estimate, strict=True))
    for name, inertia in LOADS.items():
        assert found[f"rotor_inertia[{name}]"] == pytest.approx(inertia, rel=0.01)
    for name in ("motor_constant", "rotor_friction.coulomb", "voltage_dead_zone.half_width"):
        assert found[name] == pytest.approx(TRUTH[name], rel=0.05)
    assert [*fit.by_record] == [*LOADS]
    assert [rows["rotor_inertia"].value for rows in fit.by_record.values()] == [
        found[f"rotor_inertia[{name}]"] for name in LOADS
    ]


def test_loads_are_recovered_that_are_far_apart_and_nothing_is_given():
    records = [experiment("bare", 1e-4), experiment("flywheel", 4e-3)]
    fit = emsid.fit(rigid_motor(), records, per_record="rotor_inertia", free=FREE)
    bare, flywheel = (rows["rotor_inertia"].value for rows in fit.by_record.values())
    assert flywheel / bare == pytest.approx(40, rel=0.02)
    assert emsid.compare(fit, records[1]).rows[0].simulation_rmse < 0.35  # noise of 0.3


def test_a_load_adds_to_a_rotor_that_is_known():
    records = [experiment(name, inertia) for name, inertia in LOADS.items()]
    fit = free = [name for name in FREE if name != "rotor_inertia"]
    fit = by_record(records, free=free, fixed={**KNOWN, "rotor_inertia": 1e-4}, per_record="load_inertia")
    for name, inertia in LOADS.items():
        assert fit.by_record[name]["load_inertia"].value == pytest.approx(inertia - 1e-4, rel=0.02)


@pytest.mark.parametrize("count", [3, pytest.param(6, marks=pytest.mark.long)])
def test_intervals_hold_their_values_in_the_share_of_records_that_they_claim(count):
    inside = []
    for seed in range(count):
        fit = by_record(experiments(seed, samples=150), hold="zero", find_start=False)
        truth = [TRUTH.get(name, LOADS.get(name[name.find("[") + 1 : -1])) for name in fit.names]
        low, high = fit.interval().T
        inside += list((low < truth) & (truth < high))
    margin = 1.96 * np.sqrt(0.95 * 0.05 / len(inside))
    assert abs(np.mean(inside) - 0.95) < margin + 0.01  # friction of the simulator is smooth at rest


def test_the_derivative_is_zero_outside_the_record_of_a_parameter(records):
    plant = PlantByRecord.of(rigid_motor().with_values(TRUTH | KNOWN), ("rotor_inertia",), tuple(LOADS))
    own = plant.expanded(["rotor_inertia"])
    signals, states = (Signal.SPEED,), [np.zeros(3)] * 3
    problem = FreeRunError(plant, signals, records, ("motor_constant", *own), states, [()] * 3, all_alike, 1)
    blocks = problem.exactly(problem.start)
    for k, record in enumerate(records):
        jacobian = blocks[k][1]
        assert not jacobian[:, [1 + other for other in range(3) if other != k]].any()
        alone = FreeRunError(
            plant.of_record(k), signals, [record], ("motor_constant", "rotor_inertia"), states[:1], [()], all_alike, 1
        )
        assert np.allclose(jacobian[:, [0, 1 + k]], alone.exactly(alone.start)[0][1], rtol=1e-6, atol=1e-3)


def test_parameters_that_all_differ_are_those_of_separate_fits(records):
    one = by_record(records[:2], per_record=FREE)
    for record in records[:2]:
        alone = emsid.fit(rigid_motor(), record, free=FREE, fixed=KNOWN)
        rows = one.by_record[record.name]
        assert [rows[name].value for name in FREE] == pytest.approx(list(alone.estimate), rel=2e-3)
    assert all("[" in quantity.name for quantity in one.model.plant.quantities()), "also ratios of own parameters"


def test_one_record_is_fitted_as_ever_and_a_finding_says_so(records):
    alone, ever = by_record(records[0]), emsid.fit(rigid_motor(), records[0], free=FREE, fixed=KNOWN)
    assert list(alone.estimate) == list(ever.estimate)
    assert np.array_equal(alone.covariance, ever.covariance)
    assert codes(alone)[0] == "single-record"
    assert alone.findings[0].data == {"parameters": ["rotor_inertia"]}
    assert "single-record" not in codes(ever)


def test_a_record_runs_with_its_own_load_and_another_one_with_the_median(fit, records, tmp_path):
    emsid.save(fit.model, tmp_path / "motor.json")
    model = emsid.load(tmp_path / "motor.json")
    assert isinstance(model, GreyBox)
    for record in records:
        assert emsid.compare(model, record).rows[0].simulation_rmse < 0.35  # noise of 0.3
        assert np.array_equal(model.simulate(record).output, fit.model.simulate(record).output)
    median = fit.by_record["disc"]["rotor_inertia"].value
    assert model.plant.value("rotor_inertia") == median
    finding = next(each for each in fit.findings if each.code == "parameters-by-record")
    assert finding.data == {
        "parameters": ["rotor_inertia"], "records": [*LOADS], "typical": [median], "units": ["kg*m^2"]
    }  # fmt: skip
    new = replace(records[2], name="new")
    assert np.array_equal(
        model.simulate(new).output, replace(model, plant=model.plant.of_record(1)).simulate(new).output
    )
    joined = emsid.concatenate(records)
    assert np.array_equal(model.simulate(joined).output[-500:], model.simulate(records[2]).output)


def test_a_load_that_no_record_shows_is_kept_and_named(records):
    fit = by_record(records[:2], free=(*FREE, "resistance"), fixed={"rotor_viscous": 0.0})
    kept = [row.name for row in fit.table if row.status == "not identifiable: kept at start"]
    assert kept == ["resistance"]  # the loads are determined relative to it
    still = experiment("still", 1e-3, noise=0.0)
    still = replace(still, input=0.01 * still.input, output=np.zeros_like(still.output))
    fit = by_record([records[0], still])
    row = fit.by_record["still"]["rotor_inertia"]
    assert row.status == "not identifiable: kept at start"
    assert "not-identifiable" in codes(fit)


def test_records_with_the_same_name_are_numbered(records):
    fit = by_record([replace(record, name="record") for record in records[:2]], max_iterations=3)
    assert [*fit.by_record] == ["1", "2"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"per_record": "load"}, "has no parameter 'load'"),
        ({"per_record": "resistance"}, "resistance cannot be fixed and differ by record"),
        ({"per_record": ["rotor_friction.coulomb", "rotor_friction.coulomb.forward"]}, "overlap: both set one value"),
        ({"bounds": {"rotor_inertia": (1.0, 2.0)}}, "exclude its start"),
    ],
)
def test_impossible_arguments_are_refused(records, options, message):
    with pytest.raises(ModelError, match=message):
        by_record(records[:2], **options)


def test_a_model_file_with_other_parameters_in_one_record_is_refused(fit):
    data = json.loads(json.dumps(fit.model.to_data()))
    data["plant"]["by_record"]["wheel"] = {"motor_constant": 1.0}
    with pytest.raises(ModelError, match="do not have the same parameters of their own"):
        GreyBox.from_data(data)


def test_a_record_of_several_experiments_remembers_them(records):
    joined = emsid.concatenate(records)
    assert joined.experiments == tuple(LOADS)
    assert joined[450:1200].experiments == tuple(LOADS)
    assert joined[1100:].experiments == ("wheel",)
    gap = np.zeros(len(joined), dtype=bool)
    gap[600:700] = True
    assert joined.mask(gap).experiments == ("bare", "disc", "disc", "wheel")
    assert emsid.concatenate([records[0], records[0]]).sources == ()


@pytest.mark.usefixtures("figures_undrawn", "no_refinements")
def test_the_command_line_prints_and_writes_every_load(tmp_path, command, capsys):
    files = []
    for name in ("bare", "wheel"):
        record = experiment(name, LOADS[name], samples=200)
        table = np.column_stack([record.time, record.input, record.output])
        files.append(str(tmp_path / f"{name}.csv"))
        np.savetxt(files[-1], table, delimiter=",", header="t,u,w", comments="")
    out = tmp_path / "out"
    asked = ["--models", "rigid-motor", "--free", ",".join(FREE), "--fix", "R=1", "--fix", "rotor_viscous=0"]
    channels = ["-u", "u", "-y", "w", "--time", "t", "--unit", "u=V", "--unit", "w=rad/s"]
    assert (
        command("identify", *files, *channels, *asked, "--per-record", "rotor_inertia", "--details", "--out", out) == 0
    )
    assert "by record" in capsys.readouterr().out
    content = checked(json.loads((out / "result.json").read_text()))
    rows = {row.record: row for row in content.fits[0].parameters if row.record}
    assert [*rows] == ["bare.csv", "wheel.csv"]
    for name, inertia in (("bare.csv", LOADS["bare"]), ("wheel.csv", LOADS["wheel"])):
        assert rows[name].value == pytest.approx(inertia, rel=0.03)
    page = (out / "report.html").read_text()
    assert "rotor_inertia" in page
    assert "kg·m²" in page


# --- estimated again on a new record ---


def test_a_load_is_estimated_again_and_the_rest_judges(fit):
    heavier = experiment("heavier", 1e-3, seed=5)
    found = emsid.reestimate(fit, heavier, "rotor_inertia", part=0.4)
    assert found.fit.names == ("rotor_inertia",)
    assert found.fit.estimate[0] == pytest.approx(1e-3, rel=0.01)
    assert 0 < found.fit.standard_error[0] < 5e-6
    assert len(found.assessment.record) == 300
    assert found.assessment.row.simulation_rmse < 0.35 < 2 * 0.35 < found.before.simulation_rmse
    assert found.finding.data["samples"] == 200
    motor = found.fit.model.plant
    assert motor.value("motor_constant") == fit.model.plant.value("motor_constant")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"free": "load"}, "has no parameter 'load'"),
        ({"free": ()}, "no parameter is named"),
        ({"part": 1.0}, "a part of 1; give a fraction"),
        ({"part": 0.02}, "the first 2 % cannot show rotor_inertia"),
        ({"model": emsid.fit}, "is no model"),
    ],
)
def test_what_cannot_be_estimated_again_is_refused(fit, changes, message):
    record = experiment("heavier", 1e-3)
    resting = np.arange(len(record)) < 50
    record = replace(record, input=record.input * ~resting[:, None], output=record.output * ~resting[:, None])
    options = {"model": fit, "free": "rotor_inertia", **changes}
    with pytest.raises(emsid.EmsidError, match=message):
        emsid.reestimate(record=record, **options)


def test_a_regression_has_nothing_to_estimate_again(records):
    with pytest.raises(ModelError, match="arx has no physical parameters"):
        emsid.reestimate(emsid.fit(emsid.arx(na=1, nb=1), records[0]), records[1], "rotor_inertia")


def test_validate_says_what_it_estimated_again(fit, tmp_path, command, capsys):
    record = experiment("heavier", 1e-3, seed=5)
    path, model = tmp_path / "heavier.csv", tmp_path / "motor.json"
    table = np.column_stack([record.time, record.input, record.output])
    np.savetxt(path, table, delimiter=",", header="t,u1,y1", comments="")
    emsid.save(fit.model, model)
    channels = ["-u", "u1", "-y", "y1", "--time", "t", "--unit", "u1=V", "--unit", "y1=rad/s"]
    assert command("validate", model, path, *channels, "--free", "rotor_inertia", "--part", "0.4", "--json") == 0
    found = json.loads(capsys.readouterr().out)["records"][0]["reestimated"]
    assert [row["name"] for row in found["parameters"]] == ["rotor_inertia"]
    assert found["parameters"][0]["value"] == pytest.approx(1e-3, rel=0.05)
    assert found["finding"]["code"] == "parameters-reestimated"
    assert command("validate", model, path, *channels, "--free", "load") != 0
