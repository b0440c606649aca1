"""Play: the free run of a model with other parameters, over its own record or another input."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import emsid
from emsid.errors import DataError, EmsidError
from emsid.estimation.threads import one_blas_thread
from emsid.studio.data import Signal

Array = NDArray[np.float64]
SAMPLES = 10_000
"""Most samples of an input that is played."""
RANGE = 2.0
"""A slider reaches this multiple of an estimate, in both directions."""

SHAPES: dict[str, Callable[[Array], Array]] = {
    "step": lambda x: np.where(x >= 0.1, 1.0, 0.0),
    "sine": lambda x: np.sin(6 * np.pi * x),
    "ramp": lambda x: np.interp(x, [0.0, 0.25, 0.75, 1.0], [0.0, 1.0, -1.0, 0.0]),
}
"""Inputs of height 1 over a duration of 1: a step after a tenth, three periods, a triangle."""


@lru_cache(maxsize=16)
def _loaded(path: str, changed: int) -> Any:
    return emsid.load(path)


def loaded(path: Path) -> Any:
    """The model or fit in a file, read once."""
    return _loaded(str(path), path.stat().st_mtime_ns)


@lru_cache(maxsize=8)
def _arrays(path: str, changed: int) -> dict[str, Array]:
    with np.load(path) as found:
        return {name: found[name] for name in found.files}


def free_runs(run: Path, part: str) -> dict[str, Array]:
    """The signals on a part of the data (``unseen`` or ``fitted``), by name, with their time.

    Raises:
        DataError: where the run has none.
    """
    path = run / f"{part}.npz"
    if part not in ("unseen", "fitted") or not path.exists():
        raise DataError("this run has no free runs on such data")
    return _arrays(str(path), path.stat().st_mtime_ns)


def sliders(found: Any) -> list[dict[str, Any]]:
    """Every parameter with its value, unit and the range of its slider: its interval where that is wider."""
    model = getattr(found, "model", found)
    table = found.parameters if isinstance(found, emsid.Fit) else {}
    rows = []
    for name, value in model.parameter_values().items():
        known = table.get(name)
        ends = known.interval if known is not None and known.interval is not None else (value, value)
        reach = max(abs(value) * RANGE, 1e-12) if value else 1.0
        low, high = min(value - reach, ends[0]), max(value + reach, ends[1])
        low = max(low, 0.0) if value > 0 and known is not None and known.unit else low
        rows.append(
            {
                "name": name,
                "value": value,
                "unit": known.unit if known else "",
                "known": known is not None,
                "low": low,
                "high": high,
            }
        )
    return rows


def input_of(asked: Mapping[str, Any], own: Array, dt: float) -> Array:
    """(N, nu) the input that is asked for: the record's own, a shape, or a drawn line.

    Args:
        asked: ``kind``, ``amplitude``, ``duration`` in s, and ``points`` [(t, u), …] of a drawn line.
        own: (N, nu) the input of the record.
        dt: sample time in s.

    Raises:
        DataError: for an unknown kind, or numbers that are none.
    """
    kind = asked.get("kind", "own")
    if kind == "own":
        return own[:SAMPLES]
    try:
        amplitude, duration = float(asked.get("amplitude", 1)), float(asked.get("duration", 1))
        count = int(np.clip(round(duration / dt), 10, SAMPLES))
        shape: Array
        if kind == "drawn":
            t, u = np.array(asked["points"], dtype=float).T
            order = np.argsort(t, kind="stable")
            shape = np.interp(np.arange(count) * dt, t[order], u[order])
        else:
            shape = amplitude * SHAPES[kind](np.arange(count) / count)
    except (KeyError, ValueError, TypeError, OverflowError):
        raise DataError("give a kind of input (own, step, sine, ramp or drawn), an amplitude and a duration") from None
    if not np.isfinite(shape).all():
        raise DataError("the input has values that are no numbers")
    others = np.broadcast_to(own[:1], (count, own.shape[1])).copy()
    others[:, 0] = shape
    return others


@one_blas_thread()
def played(found: Any, values: Mapping[str, float], asked: Mapping[str, Any], own: Mapping[str, Array]) -> list[Signal]:
    """The signals to draw: input, output of the model, and the measured output over the record's own input.

    Raises:
        EmsidError: for values with which the model cannot be run.
    """
    model = getattr(found, "model", found)
    known = model.parameter_values()
    changed = {name: float(value) for name, value in values.items() if known.get(name) != value}
    if changed:
        try:
            model = model.with_parameters(**changed)
        except (ValueError, ArithmeticError) as problem:
            raise DataError(f"the model cannot be run with these values ({problem})") from None
    dt = float(own["dt"])
    u = input_of(asked, own["input"], dt)
    if asked.get("kind", "own") == "own":
        y, time = own["measured"][:SAMPLES], own["time"][:SAMPLES]
        record = emsid.Record(u, y, dt)
        output, measured = model.simulate(record).output, y[:, 0]
    else:
        time = np.asarray(np.arange(len(u)) * dt, dtype=np.float64)
        output = np.asarray(model.simulate(u, dt=None if model.dt else dt).output)
        measured = np.full(len(u), np.nan)
    columns: Sequence[Array] = (u[:, 0], output[:, 0], measured)
    return [Signal(time, np.ascontiguousarray(column), dt) for column in columns]


__all__ = ["EmsidError", "free_runs", "input_of", "loaded", "played", "sliders"]
