"""What is done with a frequency response: tables, the command, modes, the notch filter, physical plants."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import emsid
from emsid import FrequencyResponse, Record, TransferFunction, transfer_function

ANTI, RESONANCE, DAMPING, INERTIA, FRICTION, CONSTANT, DT = 40.0, 62.0, 0.01, 6e-5, 2e-4, 0.05, 5e-4


def axis() -> TransferFunction:
    """From the current of a motor to its speed, with a flexible load."""
    below, above = 2 * np.pi * ANTI, 2 * np.pi * RESONANCE
    pair = np.array([1.0, 2 * DAMPING * below, below**2])
    whole = np.polymul([1.0, FRICTION / INERTIA], [1.0, 2 * DAMPING * above, above**2])
    return TransferFunction(CONSTANT * (above / below) ** 2 / INERTIA * pair, whole, 0.0, 0.0, DT)


def measured(error: float = 0.01, dt: float | None = None) -> FrequencyResponse:
    f = np.geomspace(1.0, 300.0, 150)
    g = axis().part.response(f) if dt is None else axis().at(dt).response(f)
    rng = np.random.default_rng(0)
    noise = error * np.abs(g) * (rng.standard_normal(g.shape) + 1j * rng.standard_normal(g.shape)) / np.sqrt(2)
    return FrequencyResponse(
        f, g + noise, (error * np.abs(g)) ** 2, dt=dt, input_names=("current",), output_names=("speed",),
        input_units=("A",), output_units=("rad/s",), name="axis",
    )  # fmt: skip


def test_a_table_is_read_back_exactly(tmp_path: Path) -> None:
    one = measured(dt=5e-4)
    two = FrequencyResponse(
        one.frequency, np.tile(one.response, (1, 2, 3)), np.tile(one.total, (1, 2, 3)),  # type: ignore[arg-type]
        coherence=np.full((len(one), 2), 0.9), overlap=1.5, input_names=("a", "b", "c"),
    )  # fmt: skip
    for response in (one, two):
        emsid.write_frequency_response(response, tmp_path / "table.csv")
        found = emsid.read_frequency_response(tmp_path / "table.csv")
        np.testing.assert_allclose(found.response, response.response, rtol=1e-12)
        np.testing.assert_allclose(found.total, response.total, rtol=1e-12)  # type: ignore[arg-type]
        for field in ("dt", "overlap", "input_names", "output_units"):
            assert getattr(found, field) == getattr(response, field)
    assert found.coherence is not None
    assert found.coherence.shape == (150, 2)


def in_db(g: complex) -> float:
    return float(20 * np.log10(abs(g)))


def in_degrees(g: complex) -> float:
    return float(np.degrees(np.angle(g)))


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("Frequency (Hz),Magnitude (dB),Phase (deg)", lambda f, g: (f, in_db(g), in_degrees(g))),
        (
            "#,Frequency in Hz,Amplitude in Vpp,Gain in dB,Phase in °",
            lambda f, g: (1, f, 1.0, in_db(g), in_degrees(g)),
        ),
        ("freq [kHz];|H|;phase [rad];coherence", lambda f, g: (f / 1e3, abs(g), np.angle(g), 1.0)),
        ("omega (rad/s)\tReal\tImag", lambda f, g: (2 * np.pi * f, g.real, g.imag)),
    ],
    ids=["analyser", "oscilloscope", "ratio in radians", "parts"],
)
def test_tables_of_others_are_read(tmp_path: Path, header: str, row: Any) -> None:
    response, separator = measured(), next(each for each in ",;\t" if each in header)
    rows = zip(response.frequency, response.response[:, 0, 0], strict=True)
    lines = [header, *(separator.join(f"{x:.12g}" for x in row(f, g)) for f, g in rows)]
    (tmp_path / "bode.csv").write_text("\n".join(lines) + "\n")
    found = emsid.read_frequency_response(tmp_path / "bode.csv")
    np.testing.assert_allclose(found.frequency, response.frequency, rtol=1e-9)
    np.testing.assert_allclose(found.response, response.response, rtol=1e-6)
    assert found.dt is None


def test_a_table_without_a_response_is_refused(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("t,voltage\n0,1\n1,2\n")
    with pytest.raises(emsid.FormatError, match="needs columns of frequency, magnitude and phase"):
        emsid.read_frequency_response(tmp_path / "log.csv")


def test_modes_have_intervals_that_contain_the_truth() -> None:
    fit = emsid.fit(transfer_function(3, 2), measured())
    found = emsid.modes(fit)
    assert found.kind == ("antiresonance", "resonance")
    for values, errors, true in (
        (found.frequency, found.frequency_error, np.array([ANTI, RESONANCE])),
        (found.damping, found.damping_error, np.full(2, DAMPING)),
    ):
        assert np.all(np.abs(values - true) < 4 * errors)
        assert np.all(errors < 0.1 * true)
    assert found.to_frame()["frequency_low"][0] < ANTI < found.to_frame()["frequency_high"][0]
    assert len(emsid.modes(axis())) == 2
    discrete = emsid.modes(emsid.fit(transfer_function(3, 2, discrete=True), measured(dt=5e-4)))
    np.testing.assert_allclose(discrete.frequency[-1], RESONANCE, rtol=2e-3)


def test_the_notch_of_a_controller_is_at_the_measured_mode() -> None:
    rigid = emsid.plants.motor().with_values({"motor_constant": CONSTANT})
    plant = emsid.plants.rigid_motor().with_values(
        {"rotor_inertia": INERTIA, "rotor_viscous": FRICTION, "motor_constant": CONSTANT}
    )
    fit = emsid.fit(transfer_function(3, 2), measured())
    alone, found = emsid.control(plant, dt=1e-3, limit=24.0), emsid.control(plant, dt=1e-3, limit=24.0, modes=fit)
    assert found.plants.mode is not None
    frequency, damping = found.plants.mode
    np.testing.assert_allclose((frequency / (2 * np.pi), damping), (RESONANCE, DAMPING), rtol=0.05)
    assert found.bandwidth < alone.bandwidth
    assert found.margins.gain >= 2
    with pytest.raises(emsid.ModelError, match="has no resonance above an antiresonance"):
        emsid.control(plant, dt=1e-3, modes=TransferFunction(np.ones(1), np.array([1.0, 2.0]), 0.0, 0.0, 1e-3))
    with pytest.raises(emsid.ModelError, match=r"has a shaft|no resonance|not"):
        emsid.control(rigid, dt=1e-3, modes=fit)


def two_masses() -> Any:
    return emsid.plants.motor().with_values(
        {
            "resistance": 1.0, "motor_constant": 0.05, "rotor_inertia": 2e-5, "load_inertia": 4e-5,
            "shaft_stiffness": 3.0, "shaft_damping": 1e-3, "rotor_friction.coulomb": 0.0,
        }
    )  # fmt: skip


def response_of_plant(error: float) -> FrequencyResponse:
    from emsid.models.kinds import capabilities_of
    from emsid.models.plants.grey_box import GreyBox
    from emsid.models.plants.parameters import Signal

    model = GreyBox(two_masses(), (Signal.ROTOR_SPEED,))
    f, rng = np.geomspace(1.0, 300.0, 80), np.random.default_rng(1)
    g = capabilities_of(model).linear_part(model, 0.0).response(f)[:, :1, :1]
    noise = error * np.abs(g) * (rng.standard_normal(g.shape) + 1j * rng.standard_normal(g.shape)) / np.sqrt(2)
    return FrequencyResponse(
        f, g + noise, (error * np.abs(g)) ** 2, input_units=("V",), output_units=("rad/s",), output_names=("speed",)
    )


FREE = ["motor_constant", "rotor_inertia", "load_inertia", "shaft_stiffness", "shaft_damping"]


def test_two_masses_are_fitted_to_a_frequency_response_alone_and_with_a_record() -> None:
    plant, response = two_masses(), response_of_plant(0.05)
    true = np.array([plant.value(name) for name in FREE])
    how: dict[str, Any] = {"fixed": {"resistance": 1.0}, "signals": "rotor speed", "free": FREE}
    alone = emsid.fit(emsid.plants.motor(), response, **how)
    assert alone.names == tuple(FREE)
    assert np.all(np.abs(alone.estimate - true) < 4 * alone.standard_error)
    from emsid.models.plants.grey_box import GreyBox

    model, rng = GreyBox(plant, alone.model.signals), np.random.default_rng(2)
    u = np.repeat(rng.uniform(-6, 6, 40), 25)[:, None]
    y = model.run(model.at_rest(0.0, 1e-3), u)[0]
    record = Record(
        u, y + rng.standard_normal(y.shape), 1e-3, ("voltage",), ("speed",), ("V",), ("rad/s",),
        signals={"speed": "rotor speed"},
    )  # fmt: skip
    both = emsid.fit(emsid.plants.motor(), [record, response], **how)
    assert np.all(np.abs(both.estimate - true) < 4 * both.standard_error)
    assert np.all(both.standard_error < 1.05 * alone.standard_error)


def test_what_a_response_does_not_determine_is_kept_and_named() -> None:
    fit = emsid.fit(emsid.plants.motor(), response_of_plant(0.01), signals="rotor speed")
    assert "resistance" not in fit.names
    assert "kept-by-response" in {finding.code for finding in fit.findings}
    assert "the response does not determine resistance; kept at resistance = 2 Ω" in str(fit)


def test_the_command_estimates_fits_and_writes(tmp_path: Path, run: Any) -> None:
    rng = np.random.default_rng(3)
    u = np.tile(3 * rng.standard_normal(2000), 4)
    y = emsid.simulate(axis(), u).output[:, 0] + 0.5 * rng.standard_normal(8000)
    record = Record(u[2000:], y[2000:], 5e-4, ("current",), ("speed",), ("A",), ("rad/s",))
    time = emsid.write_record(record, tmp_path / "log.csv")
    words = [str(tmp_path / "log.csv"), "-u", "current", "-y", "speed", "--time", time]
    table, out = tmp_path / "response.csv", tmp_path / "out"
    code, printed, _ = run("frequency", *words, "--poles", "3", "--table", str(table), "--out", str(out))
    assert code == 0
    assert "periodic, 1 experiment of 3 periods" in printed
    assert (out / "report.html").exists()
    shown = json.loads(run("show", str(out / "transfer-function.json"), "--json")[1])
    assert shown["models"][0]["linear"]["modes"]["frequency"][-1] == pytest.approx(RESONANCE, rel=0.01)
    code, printed, _ = run("frequency", str(table), "--band", "10-100", "--json")
    assert code == 0
    columns = json.loads(printed)["columns"]
    assert 10 <= columns["frequency"][0] < columns["frequency"][-1] <= 100


def test_a_mode_has_a_peak_or_a_dip() -> None:
    """Neither a pair of damping ratio 0.8 has one, nor a pole of a sampled model on the negative real axis."""
    found = [
        len(emsid.modes(TransferFunction(np.ones(1), np.array([1.0, 2 * ratio, 1.0]), 0.0, 0.0, DT)).frequency)
        for ratio in (0.6, 0.8)
    ]
    assert found == [1, 0]
    sampled = emsid.LinearSystem(np.diag([-0.5, 0.9]), np.ones((2, 1)), np.ones((1, 2)), np.zeros((1, 1)), DT)
    assert not len(emsid.modes(sampled).frequency)


def test_modes_are_exported_with_their_intervals(tmp_path: Path) -> None:
    fit = emsid.fit(transfer_function(3, 2), measured())
    (table,) = (each for each in emsid.export(fit, "csv", tmp_path / "one", name="axis") if each.suffix == ".csv")
    assert table.name == "axis_modes.csv"
    head, *rows = table.read_text().splitlines()
    assert head.startswith("kind,frequency [Hz],frequency_low [Hz],frequency_high [Hz],damping [1],")
    kind, frequency, low, high, damping, *_ = rows[1].split(",")
    assert kind == "resonance"
    columns = emsid.modes(fit).columns()
    assert [float(low), float(frequency), float(high)] == [
        columns[name][1] for name in ("frequency_low", "frequency", "frequency_high")
    ]
    assert float(damping) == pytest.approx(DAMPING, rel=0.2)
    emsid.export(fit.model, "csv", tmp_path / "two", name="axis")
    assert (tmp_path / "two" / "axis_modes.csv").read_text().startswith("kind,frequency [Hz],damping [1]\n")


def test_a_report_has_the_modes_of_a_linear_model_and_its_poles_with_intervals() -> None:
    from emsid.report.views.sections import model_section

    rng = np.random.default_rng(82_000)
    u = rng.standard_normal(3000)
    y = emsid.simulate(axis(), u).output[:, 0]
    record = Record(u, y + 0.02 * y.std() * rng.standard_normal(3000), DT)
    fit = emsid.fit(emsid.state_space(3), record, free_run=True)
    section = model_section(fit, record)
    (table,) = (each for each in section.tables if each.header[0] == "mode")
    found = emsid.modes(fit)
    assert [row[0] for row in table.rows] == list(found.kind)
    np.testing.assert_allclose([float(row[1]) for row in table.rows], found.frequency, rtol=1e-3)
    assert all(float(row[2]) > 0 for row in table.rows)
    (figure,) = (each for each in section.figures if each.name == "state-space-poles")
    assert "95 % intervals" in figure.caption
    first_order = emsid.fit(emsid.arx(1, 1), record)
    assert all(each.header[0] != "mode" for each in model_section(first_order, record).tables)


def test_a_fitted_state_space_is_exported_in_modal_form() -> None:
    """One with a noise model as well: its C code has blocks of two states."""
    rng = np.random.default_rng(81_000)
    u = rng.standard_normal(4000)
    y = emsid.simulate(axis(), u).output[:, 0]
    fit = emsid.fit(emsid.state_space(4), Record(u, y + 0.02 * y.std() * rng.standard_normal(4000), DT))
    assert fit.model.k.any()
    beside = [fit.model.a[i, j] for i in range(4) for j in range(4) if i // 2 != j // 2]
    assert not np.any(beside)
    dense = fit.model.with_estimates(fit.names, fit.estimate)
    np.testing.assert_allclose(dense.in_modal_form().response([5.0, 62.0]), dense.response([5.0, 62.0]), rtol=1e-9)
    nilpotent = emsid.StateSpaceModel(
        np.eye(3, k=1), np.ones((3, 1)), np.ones((1, 3)), np.zeros((1, 1)), np.zeros((3, 1)), np.zeros(1), DT
    )
    assert nilpotent.in_modal_form() is nilpotent
