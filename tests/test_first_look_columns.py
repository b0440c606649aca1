"""What a column holds: quantity and unit by its name, codes, resolution, and stuck values."""

from __future__ import annotations

import numpy as np
import pytest

from emsid.estimation.uncertainty.rounding import quantisation
from emsid.first_look import describe
from emsid.first_look.columns import column_of_numbers
from emsid.first_look.names import ColumnQuantity, meaning
from first_look_records import N, U, Write, Y


@pytest.mark.parametrize(
    ("name", "quantity", "unit"),
    [
        ("Motor_Speed(RPM)", ColumnQuantity.SPEED, "rpm"),
        ("t_ms", ColumnQuantity.TIME, "ms"),
        ("Timestamp(ms)", ColumnQuantity.TIME, "ms"),
        ("Commanded_PWM", ColumnQuantity.DUTY, ""),
        ("mVel", ColumnQuantity.SPEED, ""),
        ("w [deg/s]", ColumnQuantity.SPEED, "deg/s"),
        ("i [A]", ColumnQuantity.CURRENT, "A"),
        ("y(n)", ColumnQuantity.OUTPUT, ""),
        ("Drehzahl [U/min]", ColumnQuantity.SPEED, "rpm"),
        ("Drehzahl / (1/min)", ColumnQuantity.SPEED, "rpm"),
        ("Motorspannung", ColumnQuantity.VOLTAGE, ""),
        ("Ankerstrom_A", ColumnQuantity.CURRENT, "A"),
        ("Istdrehzahl", ColumnQuantity.SPEED, ""),
        ("Solldrehzahl", ColumnQuantity.REFERENCE, ""),
        ("Wicklungstemperatur", ColumnQuantity.OTHER, ""),
        ("Vitesse (tr/min)", ColumnQuantity.SPEED, "rpm"),
        ("Tensión (V)", ColumnQuantity.VOLTAGE, "V"),
        ("Winkel in Grad", ColumnQuantity.POSITION, "deg"),
        ("U/V", ColumnQuantity.INPUT, "V"),
        ("v m/s", ColumnQuantity.SPEED, "m/s"),
        ("/odom/v", ColumnQuantity.VOLTAGE, ""),
        ("speed_ref", ColumnQuantity.REFERENCE, ""),
        ("u11", ColumnQuantity.INPUT, ""),
        ("ω", ColumnQuantity.SPEED, ""),
        ("c3", ColumnQuantity.UNKNOWN, ""),
        ("x [furlong]", ColumnQuantity.UNKNOWN, ""),
    ],
)
def test_what_a_name_says(name: str, quantity: ColumnQuantity, unit: str) -> None:
    said = meaning(name)
    assert (said.quantity, said.unit) == (quantity, unit)
    assert (said.confidence > 0) is (quantity is not ColumnQuantity.UNKNOWN)


def test_isolated_whole_numbers_are_codes() -> None:
    pwm = np.concatenate([np.arange(-255, 256), [1000] * 5, [-9999] * 7])
    column = column_of_numbers("PWM", "numbers", meaning("PWM"), pwm.astype(float))
    assert [(code.value, code.count) for code in column.codes] == [(-9999, 7), (1000, 5)]
    assert (column.low, column.high, column.step) == (-255, 255, 1)
    assert np.isnan(column.signal[-12:]).all()


@pytest.mark.parametrize(
    "values",
    [
        np.arange(-255.0, 256.0),
        np.append(np.linspace(0, 1, 100), [1000.5] * 3),  # no whole number
        np.append(np.arange(100.0), [1000.0]),  # an outlier: it occurs once
        np.repeat([0.0, 100.0, 1000.0], 50),  # levels of a command
    ],
)
def test_other_values_are_no_codes(values: np.ndarray) -> None:
    assert column_of_numbers("u", "numbers", meaning("u"), values).codes == ()


def test_quantisation_survives_rounding_in_the_file() -> None:
    rng = np.random.default_rng(2)
    step = 0.0024414
    assert quantisation(np.unique(np.round(step * np.arange(300), 6))) == pytest.approx(step, rel=1e-4)
    assert quantisation(np.unique(rng.standard_normal(300))) is None
    assert quantisation(np.array([3.0])) is None


def test_a_value_that_stays_is_stuck_only_if_that_is_unusual() -> None:
    rng = np.random.default_rng(2)
    y = rng.standard_normal(2000)
    y[700:900] = y[700]
    (stuck,) = column_of_numbers("y", "numbers", meaning("y"), y).stuck
    assert (stuck.start, stuck.length) == (700, 200)
    assert column_of_numbers("y", "numbers", meaning("y"), rng.standard_normal(2000)).stuck == ()


def test_columns_of_a_file(write: Write) -> None:
    state = "".join(f"{0.01 * k:.2f},RUN,2,{U[k]},{Y[k]}\n" for k in range(N))
    look = describe(write("t,state,gain,u,y\n" + state))
    assert [column.kind for column in look.columns] == ["numbers", "text", "numbers", "numbers", "numbers"]
    assert look["gain"].constant
    assert look.reading == {"input": "u", "output": "y", "time": "t"}
