"""Units: conversion, printed names, and units that are refused."""

from __future__ import annotations

from math import pi

import pytest

from emsid.errors import DataError
from emsid.units import SI, conversion, per_unit, readable_unit


@pytest.mark.parametrize(
    ("unit", "gain", "si"),
    [
        ("rpm", pi / 30, "rad/s"),
        ("RPM", pi / 30, "rad/s"),
        ("deg/s", pi / 180, "rad/s"),
        ("°/s", pi / 180, "rad/s"),
        ("rev/s", 2 * pi, "rad/s"),
        ("deg", pi / 180, "rad"),
        ("rad/s/s", 1.0, "rad/s^2"),
        ("mV", 1e-3, "V"),
        ("kΩ", 1e3, "ohm"),
        ("mH", 1e-3, "H"),
        ("mm", 1e-3, "m"),
        ("m/s", 1.0, "m/s"),
        ("mm/s/s", 1e-3, "m/s^2"),
        ("m/s^4", 1.0, "m/s^4"),
        ("km/s^4", 1e3, "m/s^4"),
        ("Nm", 1.0, "N*m"),
        ("mNm", 1e-3, "N*m"),
        ("N·m", 1.0, "N*m"),
        ("nm", 1e-9, "m"),
        ("g*cm^2", 1e-7, "kg*m^2"),
        ("kg·m²", 1.0, "kg*m^2"),
        ("%", 0.01, "1"),
        ("1", 1.0, "1"),
        ("Hz", 1.0, "1/s"),
        ("N*m*s/rad", 1.0, "N*m*s/rad"),
        ("V*s/rad", 1.0, "V*s/rad"),
    ],
)
def test_si_of_the_units_that_drives_are_logged_in(unit: str, gain: float, si: str) -> None:
    converted = conversion(unit)
    assert converted.gain == pytest.approx(gain, rel=1e-12)
    assert converted.offset == 0
    if unit != "Hz":
        assert converted.unit == si
    else:
        assert "rad" not in converted.unit  # a frequency is not a speed


@pytest.mark.parametrize(
    ("unit", "same"), [("m/s²", "m/s^2"), ("kg·m²", "kg*m^2"), ("N·s⁻²", "N/s^2"), ("ｒａｄ／ｓ", "rad/s")]
)
def test_a_raised_or_wide_sign_is_read_as_its_usual_form(unit: str, same: str) -> None:
    assert conversion(unit).gain == conversion(same).gain
    assert conversion(unit, same).gain == 1.0


def test_temperatures_have_an_offset() -> None:
    assert conversion("°C") == (pytest.approx(1.0), pytest.approx(273.15), "K")


def test_a_target_and_its_inverse_cancel() -> None:
    there, back = conversion("rad/s", "rpm"), conversion("rpm", "rad/s")
    assert there.gain * back.gain == pytest.approx(1.0)
    assert there.unit == "rpm"


def test_counts_samples_and_pwm_have_the_meaning_they_are_given() -> None:
    speed = conversion("count/sample", sample_time=0.01, counts_per_revolution=621)
    assert speed.gain == pytest.approx(2 * pi / 621 / 0.01)
    assert speed.unit == "rad/s"
    assert conversion("counts", counts_per_revolution=4).gain == pytest.approx(pi / 2)
    assert conversion("pwm", supply_voltage=12) == (pytest.approx(12 / 255), 0.0, "V")
    assert conversion("PWM", supply_voltage=12, pwm_full_scale=1000).gain == pytest.approx(0.012)
    # one meaning does not stick to the next call
    assert conversion("pwm", supply_voltage=24).gain == pytest.approx(24 / 255)


def test_a_meaning_that_the_unit_does_not_use_is_not_looked_at() -> None:
    assert conversion("V", counts_per_revolution=0, supply_voltage=-1, pwm_full_scale=0).gain == 1.0


@pytest.mark.parametrize(
    ("unit", "target", "meanings", "message"),
    [
        ("count", None, {}, "the size of a 'count' is not known; give counts_per_revolution"),
        ("count", None, {"counts_per_revolution": 0}, "give counts_per_revolution"),
        ("counts/sample", None, {"counts_per_revolution": 9}, "the size of a 'sample' is not known; give dt"),
        ("pwm", None, {}, "give supply_voltage"),
        ("pwm", None, {"supply_voltage": float("inf")}, "give supply_voltage"),
        ("pwm", None, {"supply_voltage": 12, "pwm_full_scale": 0}, "pwm_full_scale is"),
        ("V", "A", {}, "unit 'V' cannot become 'A'"),
        ("furlong pairs", None, {}, "is not understood"),
        ("kg*", None, {}, "is not understood"),
        ("3 V", None, {}, "is not understood"),
        ("__import__('os')", None, {}, "is not understood"),
    ],
)
def test_what_is_no_unit(unit: str, target: str | None, meanings: dict[str, float], message: str) -> None:
    with pytest.raises(DataError, match=message) as caught:
        conversion(unit, target, **meanings)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text",
    [
        *("9**9**9**9", "m**9**9**9", "((9**9)**9)**9", "m^99", "m^1e5", "V" * 100),
        *("9⁹⁹⁹⁹⁹⁹⁹⁹⁹", "V²²²²²²²²²", "m⁹²", "9^9⁹", "(m²)³", "9＾９＾９＾９", "9**٩٩٩", "9 squared squared cubed"),
    ],
)
def test_powers_without_end_are_refused_at_once(text: str) -> None:
    with pytest.raises(DataError, match="is not understood"):
        conversion(text)


@pytest.mark.parametrize(
    ("above", "below", "ratio"),
    [
        ("rad/s", "V", "rad/(s*V)"),
        ("rad/s", "V*s/rad", "rad^2/(s^2*V)"),
        ("rad/s", "rad/s", "1"),
        ("N*m/A", "ohm", "N*m/(A*ohm)"),
        ("kg*m^2", "N*m*s", "kg*m/(N*s)"),
        ("count/sample", "pwm", "count/(sample*pwm)"),
        ("V", "1", "V"),
        ("1", "m/s", "s/m"),
        ("", "V", ""),
        ("V^0.5", "A", "(V^0.5)/(A)"),
    ],
)
def test_the_unit_of_a_ratio_has_one_fraction_bar(above: str, below: str, ratio: str) -> None:
    assert per_unit(above, below) == ratio


def test_a_gain_is_printed_as_a_textbook_prints_it() -> None:
    assert readable_unit(per_unit("rad/s", "V")) == "rad/(s·V)"


@pytest.mark.parametrize("unit", SI)
def test_an_si_unit_is_known_without_the_registry(unit: str) -> None:
    assert conversion(unit) == conversion(f"1*{unit}") == (1.0, 0.0, unit)
