"""Simulated differences between records are found with their size; equal records give no finding."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from emsid import ModelError, Record, arx, concatenate, identify, least_squares
from emsid.models.model import Run
from emsid.validation.agreement import disagreement, lateness

Array = NDArray[np.float64]

DT, SAMPLES, NOISE = 0.01, 800, 0.01
TIME = DT * np.arange(SAMPLES)


def moved(delay: float) -> Array:
    """(N,) an output of many frequencies, below a fifth of the sampling rate, this many seconds late."""
    return np.sum([np.sin(2 * np.pi * f * (TIME - delay) + f**2) for f in (0.3, 0.7, 1.9, 3.1)], axis=0)


def measured(name: str, delay: float = 0.0, gain: float = 1.0, level: float = 0.0, seed: int = 0) -> Record:
    noise = NOISE * np.random.default_rng(seed).standard_normal(SAMPLES)
    output = gain * moved(delay) + level + noise
    return Record(TIME, output, DT, output_names=("speed",), output_units=("rad/s",), name=name)


@dataclass(frozen=True)
class Known:
    """A model whose free run is known: a function of the input, which is the time."""

    name: str = "known"
    memory: int = 5
    diverges: bool = False

    def simulate(self, record: Record, transient: int | None = None) -> Run:
        if len(record) <= self.memory:
            raise ModelError("too short")
        rows = np.rint(record.input[:, 0] / DT).astype(int)
        counted = np.ones(len(record), dtype=bool)
        for first in (0, *record.breaks):
            counted[first : first + self.memory] = False
        return Run(moved(0.0)[rows][:, None], counted, 7 if self.diverges else None)


@pytest.mark.parametrize(
    ("difference", "values"),
    [("delay", (-2e-3, 3e-3)), ("gain", (0.96, 1.05)), ("level", (-0.2, 0.1))],
)
def test_what_differs_comes_back(difference: str, values: tuple[float, float]) -> None:
    records = [
        measured(name, seed=k, **{difference: value})
        for k, (name, value) in enumerate(zip(("a.csv", "b.csv"), values, strict=True))
    ]
    found = disagreement(Known(), records)  # type: ignore[arg-type]
    assert found is not None
    assert found.difference.name == difference
    assert found.records == ("a.csv", "b.csv")
    expected = np.subtract(values, 1.0) if difference == "gain" else values
    standard_error = {"delay": NOISE / 20, "gain": NOISE / 1.4, "level": NOISE}[difference] / np.sqrt(SAMPLES)
    np.testing.assert_allclose(found.values, expected, rtol=0.02, atol=4 * standard_error)
    # The common part is the model's: what is left of the squared error is noise.
    spread = np.var(expected) / np.mean(np.square(expected))
    assert found.share == pytest.approx(spread, abs=0.05)
    finding = found.finding
    assert (finding.code, finding.subject, finding.model) == ("records-differ", "speed", "known")
    assert finding.data["kind"] == difference
    assert finding.data["records"] == [
        {"name": name, "value": value} for name, value in zip(found.records, found.values, strict=True)
    ]


def test_a_record_cut_into_segments_says_the_same() -> None:
    whole = [measured("a", delay=-2e-3), measured("b", delay=3e-3, seed=1)]
    cut = [concatenate([record[:300], record[300:]], record.name) for record in whole]
    one, other = (disagreement(Known(), records) for records in (whole, cut))  # type: ignore[arg-type]
    assert one is not None
    assert other is not None
    np.testing.assert_allclose(other.values, one.values, rtol=0.02)


@pytest.mark.parametrize(
    "records",
    [
        [measured("a"), measured("b", seed=1)],
        [measured("a", delay=5e-3), measured("b", delay=5e-3, seed=1)],  # the model is wrong, and they agree
        [measured("a", gain=1.2)],
        [measured("a", gain=0.9), measured("b", gain=1.2, seed=1)[:40]],  # too short to say so
        [measured("a", gain=0.9), measured("b", gain=1.2, seed=1)[:4]],  # too short to be run
    ],
)
def test_where_records_agree_or_say_too_little_nothing_is_found(records: list[Record]) -> None:
    assert disagreement(Known(), records) is None  # type: ignore[arg-type]


def test_a_run_that_diverges_says_nothing() -> None:
    apart = [measured("a", gain=0.9), measured("b", gain=1.2)]
    assert disagreement(Known(), apart) is not None  # type: ignore[arg-type]
    assert disagreement(Known(diverges=True), apart) is None  # type: ignore[arg-type]


def test_identify_says_which_records_differ() -> None:
    """A motor of first order whose load, and so its gain, is another in the second of three records."""
    rng = np.random.default_rng(4)

    def logged(name: str, gain: float) -> Record:
        u = np.repeat(rng.uniform(-2, 2, 100), 6)
        y = np.zeros(len(u))
        for t in range(1, len(u)):
            y[t] = 0.9 * y[t - 1] + 0.1 * gain * u[t - 1]
        return Record(u, y + 0.01 * rng.standard_normal(len(u)), DT, name=name)

    records = [logged("one.csv", 1.0), logged("two.csv", 0.8), logged("three.csv", 1.0)]
    (found,) = [finding for finding in identify(records, models=["arx"]).findings if finding.code == "records-differ"]
    assert (found.subject, found.model, found.data["kind"]) == ("y1", "arx", "gain")
    values = {each["name"]: each["value"] for each in found.data["records"]}
    assert min(values, key=lambda name: values[name]) == "two.csv"
    assert values["two.csv"] < 0
    same = [logged(record.name, 1.0) for record in records]
    assert not [finding for finding in identify(same, models=["arx"]).findings if finding.code == "records-differ"]
    model = least_squares(arx(na=1, nb=1), records[0]).model
    found_alone = disagreement(model, [records[0], records[1]])
    assert found_alone is not None
    assert found_alone.values[1] == pytest.approx(-0.2, abs=0.02)


@pytest.mark.parametrize("delay", [0.6 * DT, 2.5 * DT, -1.2 * DT])
def test_a_record_that_is_late_or_early_is_named_with_its_shift(delay: float) -> None:
    record = measured("late.csv", delay)
    (found,) = lateness(record, Known().simulate(record))
    assert (found.code, found.subject) == ("record-shifted", "late.csv")
    assert found.data["delay"] == pytest.approx(delay, abs=0.05 * DT)
    assert found.data["shifted"] < 1.3 * NOISE < found.data["rmse"]


@pytest.mark.parametrize("difference", [{}, {"delay": 2e-4}, {"gain": 1.1}, {"level": 0.3}])
def test_a_record_that_differs_otherwise_is_not_late(difference: dict[str, float]) -> None:
    record = measured("other.csv", **difference)
    assert not list(lateness(record, Known().simulate(record)))
    assert not list(lateness(record, Known(diverges=True).simulate(measured("late.csv", DT))))
