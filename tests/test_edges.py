"""The edges of an encoder counted into a position: ``edges(A)`` and ``edges(A, B)``."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal

import emsid
from emsid.first_look import describe
from emsid.first_look.kinds import FileKind
from emsid.io.edges import count, states
from emsid.models.regression.free_run_fit import fit_free_run
from emsid.models.regression.structures import arx
from first_look_records import Write, codes, data, proposals

Array = NDArray[np.float64]
DT, LINES, GAIN, TAU = 0.002, 30, 2.0, 0.05


def channels(revolutions: Array) -> tuple[Array, Array]:
    """The two channels of an encoder of one line at an angle (N,); the first leads while the angle grows."""
    return (revolutions % 1 < 0.5).astype(float), ((revolutions - 0.25) % 1 < 0.5).astype(float)


def motor(rng: np.random.Generator, *, one_way: bool, n: int = 3000) -> tuple[Array, Array]:
    """The voltage of a motor (n,) and its angle in lines of the encoder."""
    u = np.repeat(rng.uniform(-6, 6, n // 150), 150)
    u = np.abs(u) + 1 if one_way else u
    pole = np.exp(-DT / TAU)
    speed = GAIN * signal.lfilter([0.0, 1 - pole], [1.0, -pole], u)
    return u, np.cumsum(speed) * DT * LINES / (2 * np.pi)


@pytest.mark.parametrize("seed", range(3))
def test_counts_are_exact(seed: int) -> None:
    """A quarter of a line each, in both directions; one channel counts half lines without a direction. Noise is not."""
    rng = np.random.default_rng(seed)
    angle = np.cumsum(0.2 * np.sin(np.arange(2000) * rng.uniform(0.01, 0.05)) + rng.uniform(-0.04, 0.04))
    quarters, halves = np.floor(4 * angle), np.floor(2 * angle)
    assert np.ptp(quarters) > 20
    assert np.diff(quarters).min() < 0 < np.diff(quarters).max()
    a, b = channels(angle)
    for first, second in ((a, b), (2 + 1.4 * a + rng.normal(0, 0.05, 2000), -5 * b + rng.normal(0, 0.2, 2000))):
        turn = 1 if second is b else -1  # an inverted channel turns the direction
        counts, missed = count(first, second)
        assert missed == 0
        np.testing.assert_array_equal(counts, turn * (quarters - quarters[0]))
        np.testing.assert_array_equal(count(first)[0], np.cumsum(np.abs(np.diff(halves, prepend=halves[0]))))


def test_a_missed_edge_is_counted_and_reported(write: Write) -> None:
    """A shaft turns steadily there and back; two rows are lost on the way there, and one on the way back."""
    angle = np.concatenate([np.arange(0.05, 20, 0.2), np.arange(19.9, 0, -0.2)])
    quarters = np.floor(4 * angle)
    missing = 1 + np.flatnonzero(np.abs(quarters[2:] - quarters[:-2]) == 2)
    kept = np.delete(np.arange(len(angle)), missing[[10, 20, -10]])
    steps = np.abs(np.diff(quarters[kept]))
    assert set(steps) == {0, 1, 2}
    a, b = channels(angle[kept])
    counts, missed = count(a, b)
    assert missed == np.count_nonzero(steps == 2)
    np.testing.assert_array_equal(counts, quarters[kept] - quarters[kept][0])
    path = write({"t": DT * np.arange(len(a)), "u": np.sign(np.gradient(angle[kept])), "A [V]": a, "B [V]": b})
    record = emsid.read(path, input="u", output="edges(A,B)", time="t")
    np.testing.assert_array_equal(record.output[:, 0], counts)
    assert record.output_units == ("count",)
    (found,) = (each for each in record.findings if each.code == "edges-missed")
    assert found.data == {"missed": missed, "edges": int(np.abs(np.diff(counts)).sum())}
    turned = emsid.read(path, input="u", output="edges(B,A)", time="t", units={"edges(B,A)": "rad"})
    np.testing.assert_array_equal(turned.output, -record.output)
    with pytest.raises(emsid.DataError, match=r"no column 'edges\(A, C\)'"):
        emsid.read(path, input="u", output="edges(A, C)", time="t")


def test_states_between_levels_and_missing_values() -> None:
    """A value between the levels, and a missing one, leave the state; the count of a missing value is missing."""
    x = np.array([0.0, 0.1, 2.4, 4.9, 5.0, 2.6, np.nan, 5.1, 2.4, 0.0, 0.1])
    np.testing.assert_array_equal(states(x), [0, 0, 0, 1, 1, 1, 1, 1, 1, 0, 0])
    counts, _ = count(x)
    np.testing.assert_array_equal(counts, [0, 0, 0, 1, 1, 1, np.nan, 1, 1, 2, 2])
    np.testing.assert_array_equal(states(np.full(3, 2.0)), [0, 0, 0])


@pytest.mark.parametrize("volts", [0.0, 5.0])
@pytest.mark.parametrize("two", [True, False])
def test_the_first_look_counts_edges(write: Write, volts: float, two: bool) -> None:
    """What is proposed gives the gain and the time constant of the motor, from logic levels and from noisy voltages."""
    rng = np.random.default_rng(7 * two + int(volts))
    u, angle = motor(rng, one_way=not two)
    pulses = dict(zip("AB", channels(angle), strict=True))
    pulses = {name: volts * x + rng.normal(0, 0.1, len(x)) if volts else x for name, x in pulses.items()}
    names = "edges(A, B)" if two else "edges(A)"
    path = write({"t": DT * np.arange(len(u)), "u": u, "A": pulses["A"], **({"B": pulses["B"]} if two else {})})
    look = describe(path)
    assert look.kind.kind is FileKind.PULSES, look.kind.evidence
    assert data(look, "encoder-pulses")["counts"] == names
    assert look.reading == {"input": "u", "output": f"d({names})", "time": "t"}
    (words,) = proposals([look])
    assert words[3:7] == ["--input", "u", "--output", f"d({names})"]
    again: dict[str, Any] = {**look.reading}
    record = emsid.read(path, **again)
    np.testing.assert_array_equal(look.record.output if look.record else 0, record.output)
    pole, gain, _ = fit_free_run(arx(1, 1, 1, 1, constant=True), [record]).estimate
    assert gain / (1 + pole) == pytest.approx((4 if two else 2) * GAIN * LINES / (2 * np.pi), rel=0.03)
    assert -DT / np.log(-pole) == pytest.approx(TAU, rel=0.2)
    named = describe(path, output=f"d({names})")
    assert (named.kind.kind, named.reading) == (FileKind.DYNAMIC, look.reading)


@pytest.mark.parametrize("seed", range(2))
def test_commands_in_turn_are_no_encoder(write: Write, seed: int) -> None:
    """Two inputs that step in turn, and an output that answers both."""
    rng = np.random.default_rng(seed)
    hold = np.repeat(np.arange(60), rng.integers(12, 30, 60))
    a, b = channels(hold / 4)
    y = signal.lfilter([0.0, 0.1], [1.0, -0.9], a + 2 * b) + rng.normal(0, 0.02, len(a))
    look = describe(write({"t": 0.01 * np.arange(len(a)), "c2": a, "c3": b, "c4": y}))
    assert look.kind.kind is FileKind.DYNAMIC, look.kind.evidence
    assert "encoder-pulses" not in codes(look)
