"""Units are converted where a record enters: in files, in Python, on unseen data, in `validate` and `simulate`."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import emsid
from emsid.cli.app import app
from emsid.models.plants.grey_box import signals_of
from emsid.models.plants.parameters import Signal

DT, RPM = 0.01, np.pi / 30


def motion(seed: int, samples: int = 500) -> tuple[np.ndarray, np.ndarray]:
    """Volts and rad/s of a motor of 20 rad/s per volt and a time constant of 80 ms."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(-6, 6, samples // 25).repeat(25)
    y = np.zeros(samples)
    for k in range(1, samples):
        y[k] = y[k - 1] + (1 - np.exp(-DT / 0.08)) * (20 * u[k - 1] - y[k - 1])
    return u, y + rng.normal(0, 0.05, samples)


def table(path, header, u, y):
    t = DT * np.arange(len(u))
    path.write_text(header + "\n" + "".join(f"{a:.6g},{b:.9g},{c:.9g}\n" for a, b, c in zip(t, u, y, strict=True)))
    return path


def record(seed: int, *, mixed: bool) -> emsid.Record:
    u, y = motion(seed)
    if mixed:
        return emsid.Record(1e3 * u, y / RPM, DT, "U", "n", "mV", "rpm")
    return emsid.Record(u, y, DT, "U", "n", "V", "rad/s")


PLANT = {"fixed": {"resistance": 2.0}, "free": ("motor_constant", "rotor_inertia")}


def test_a_record_in_other_units_gives_the_same_plant() -> None:
    fits = [emsid.fit(emsid.plants.rigid_motor(), record(1, mixed=mixed), **PLANT) for mixed in (False, True)]
    np.testing.assert_allclose(fits[1].estimate, fits[0].estimate, rtol=1e-6)
    assert fits[1].channels.outputs == (("n", "rad/s"),)
    errors = [emsid.validate(fits[0], record(2, mixed=mixed)).row.simulation_rmse for mixed in (False, True)]
    assert errors[1] == pytest.approx(errors[0], rel=1e-6)
    assert errors[0] < 0.1
    runs = [emsid.simulate(fits[0], record(2, mixed=mixed)) for mixed in (False, True)]
    assert (runs[1].input_units, runs[1].output_units) == (("V",), ("rad/s",))
    np.testing.assert_allclose(runs[1].output, runs[0].output, atol=1e-6)
    compared = emsid.compare(fits[0], record(2, mixed=True))
    assert compared.best.record.output_units == ("rad/s",)


def test_identify_takes_records_and_unseen_data_in_different_units() -> None:
    found = [
        emsid.identify(record(1, mixed=a), record(2, mixed=b), models="arx", nk=1) for a, b in ((0, 0), (1, 0), (0, 1))
    ]
    for each in found[1:]:
        np.testing.assert_allclose(each.recommended_fit.estimate, found[0].recommended_fit.estimate, rtol=1e-6)
        assert each.unseen.output_units == ("rad/s",)


def test_a_fit_of_channels_in_other_units_is_run_in_these_by_position() -> None:
    names = emsid.ChannelNames(DT, (("U", "mV"),), (("n [rpm]", ""),))
    given = names.in_these_units(emsid.Record([1.0, 2.0], [RPM, 2 * RPM], DT, "a", "b", "V", "rad/s"))
    np.testing.assert_allclose(given.input[:, 0], [1e3, 2e3])
    np.testing.assert_allclose(given.output[:, 0], [1, 2])
    assert (given.input_names, given.output_units) == (("a",), ("rpm",))


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """A model of a file without units in its header, which are given."""
    folder = tmp_path_factory.mktemp("model")
    u, y = motion(1)
    log = table(folder / "log.csv", "t,voltage,speed", 1e3 * u, y / RPM)
    words = ["identify", str(log), "-u", "voltage", "-y", "speed", "--time", "t", "--unit", "voltage=mV"]
    words += ["--unit", "speed=rpm", "--models", "arx", "--out", str(folder / "out")]
    assert CliRunner().invoke(app, words).exit_code == 0
    return folder / "out" / "arx.json"


@pytest.mark.parametrize(
    ("header", "size_u", "size_y"),
    [
        ("t,voltage,speed", 1e3, 1 / RPM),  # as in the file of the model
        ("t,drive,wheel", 1e3, 1 / RPM),  # units go by position
        ("t,drive [V],wheel [rad/s]", 1, 1),  # a header decides
        ("t,drive [mV],wheel [deg/s]", 1e3, 180 / np.pi),
        ("t,voltage [V],speed [rad/s]", 1, 1),
    ],
)
def test_validate_and_simulate_carry_units_by_position(model, tmp_path, header, size_u, size_y) -> None:
    u, y = motion(2)
    log = table(tmp_path / "other.csv", header, size_u * u, size_y * y)
    _, drive, wheel = (name.split(" [")[0] for name in header.split(","))
    columns = ["-u", drive, "-y", wheel]
    result = CliRunner().invoke(app, ["validate", str(model), str(log), *columns, "--json"])
    assert result.exit_code == 0, result.output
    assert json.loads(result.output)["records"][0]["simulation_rmse"] < 0.3  # rad/s, of 60
    out = tmp_path / "run.csv"
    assert CliRunner().invoke(app, ["simulate", str(model), str(log), "-u", drive, "--out", str(out)]).exit_code == 0
    run = emsid.read(out, input=drive, output="speed", time="t")
    assert run.output_units == ("rad/s",)
    np.testing.assert_allclose(run.output[100:, 0], y[100:], atol=1.0)


def test_a_unit_that_no_drive_is_measured_in_is_refused(tmp_path) -> None:
    log = table(tmp_path / "log.csv", "t,voltage,speed", *motion(1))
    with pytest.raises(emsid.DataError, match=r"unit 'parsec' is 3.09e\+16 m, which no drive is measured in"):
        emsid.read(log, input="voltage", output="speed", time="t", units={"speed": "parsec"})


def test_an_output_is_the_signal_that_is_given(tmp_path) -> None:
    u, y = motion(1)
    plant = emsid.plants.motor()
    given = {"output_names": ("motor", "wheel"), "output_units": ("rad/s", "rad/s")}
    both = emsid.Record(
        u, np.column_stack([y, y]), DT, signals={"motor": "rotor_speed", "wheel": "load speed"}, **given
    )
    assert signals_of(plant, both) == (Signal.ROTOR_SPEED, Signal.SPEED)
    assert signals_of(plant, both.split(0.5)[1]) == (Signal.ROTOR_SPEED, Signal.SPEED)
    with pytest.raises(emsid.DataError, match="'motor' and 'wheel' are read as the speed of"):
        emsid.fit(plant, emsid.Record(u, np.column_stack([y, y]), DT, **given))
    with pytest.raises(emsid.DataError, match="cannot be the signal 'torque'; there are speed, rotor_speed"):
        emsid.Record(u, y, DT, signals={"y1": "torque"})
    with pytest.raises(emsid.DataError, match="a signal is given for 'x', which is no output"):
        emsid.Record(u, y, DT, signals={"x": "speed"})
    log = table(tmp_path / "log.csv", "t,voltage,motor [rpm]", u, y)
    read = emsid.read(log, input="voltage", output="motor", time="t", signals={"motor": "rotor-speed"})
    assert dict(read.signals) == {"motor [rpm]": "rotor speed"}
