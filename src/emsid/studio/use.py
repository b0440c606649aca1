"""Use: what can be done with a model. Its free run with other parameters or another input, exports, and controllers.

An export, a controller, a compensation or a designed experiment is a folder of files, which is sent as an archive.
"""

from __future__ import annotations

import io
import tempfile
import zipfile
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import emsid
import emsid.compensation.files
import emsid.controllers.files
from emsid import compensation, controllers
from emsid.compensation import Compensation, MapInverse, RippleCompensation
from emsid.compensation.inverse import has_harmonics
from emsid.errors import DataError
from emsid.estimation.threads import one_blas_thread
from emsid.exports import FORMATS
from emsid.io import origin
from emsid.models.verbs import as_model
from emsid.report.control_page import compensation_report, control_report
from emsid.report.design_page import design_report
from emsid.report.document import Report
from emsid.report.page import report_files
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


def sample_time(path: Path) -> float | None:
    """The sample time of a model, or of the record that it was fitted to."""
    model, source = as_model(loaded(path)), origin(path)
    dt: float | None = model.dt
    return dt if dt is not None or source is None else source.dt


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
        asked: ``kind``, ``amplitude``, ``duration`` in s, ``points`` [(t, u), …] of a drawn line, and which ``input``
            they are, from 0; the others rest.
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
    others[:, int(asked.get("input", 0))] = shape
    return others


@one_blas_thread()
def played(path: Path, values: Mapping[str, float], asked: Mapping[str, Any], record: emsid.Record) -> list[Signal]:
    """The signals to draw: input, output of the model, and the measured output over the record's own input.

    Args:
        path: of the model.
        values: of parameters that differ from the model's.
        asked: the input, and which ``output`` is drawn, from 0.
        record: whose input and sample time are used.

    Raises:
        EmsidError: for values with which the model cannot be run.
    """
    model: Any = as_model(loaded(path))
    known = model.parameter_values()
    changed = {name: float(value) for name, value in values.items() if known.get(name) != value}
    if changed:
        try:
            model = model.with_parameters(**changed)
        except (ValueError, ArithmeticError) as problem:
            raise DataError(f"the model cannot be run with these values ({problem})") from None
    dt, k = record.dt if model.dt is None else model.dt, int(asked.get("output", 0))
    channel = int(asked.get("input", 0))
    u = input_of(asked, record.input, dt)
    if asked.get("kind", "own") == "own":
        own = record[:SAMPLES]
        time, output, measured = own.time, model.simulate(own).output, own.output[:, k]
    else:
        time = np.asarray(np.arange(len(u)) * dt, dtype=np.float64)
        output = np.asarray(model.simulate(u, dt=None if model.dt else dt).output)
        measured = np.full(len(u), np.nan)
    columns: Sequence[Array] = (u[:, channel], output[:, k], measured)
    return [Signal(time, np.ascontiguousarray(column), dt) for column in columns]


def archive(folder: Path) -> bytes:
    """The files in a folder."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as files:
        for file in sorted(folder.rglob("*")):
            if file.is_file():
                files.write(file, file.relative_to(folder))
    return content.getvalue()


def exported(path: Path, format: str, assume: Sequence[str] = ()) -> bytes:
    """A model in a format, as an archive.

    Args:
        path: the model file.
        format: its name.
        assume: parameters whose values nobody gave or measured and that may be written.

    Raises:
        DataError: for an unknown format.
        EmsidError: where the model cannot be exported like this.
    """
    if format not in FORMATS:
        raise DataError(f"there is no format {format}; there are {', '.join(FORMATS)}")
    found = loaded(path)
    dt = sample_time(path) if as_model(found).dt is None else None
    with tempfile.TemporaryDirectory() as folder:
        emsid.export(found, format, folder, dt=dt, force=True, assume=tuple(assume))
        return archive(Path(folder))


def _control(path: Path, asked: Mapping[str, Any], folder: Path) -> Report:
    found = emsid.control(loaded(path), **{"dt": sample_time(path), **asked})
    content = control_report(found)
    controllers.files.write(found, folder, more=report_files(content, formats=()))
    return content


def _compensate(path: Path, asked: Mapping[str, Any], folder: Path) -> Report:
    model, dt = loaded(path), asked.get("dt", sample_time(path))
    bench = None
    found: Compensation | MapInverse | RippleCompensation
    if dt is None or hasattr(as_model(model), "blocks") or has_harmonics(as_model(model)):
        found = emsid.compensate(model, dt=dt, encoder=asked.get("encoder"))
    else:
        found, bench = controllers.verb.compensated(model, **{**asked, "dt": dt})
    content = compensation_report(found, bench)
    lines = [] if bench is None else controllers.files.bench_lines(bench)
    compensation.files.write(model, found, folder, dt=dt, more=report_files(content, formats=()), bench=lines)
    return content


def _design(path: Path, asked: Mapping[str, Any], folder: Path) -> Report:
    found = emsid.design(loaded(path), **{"dt": sample_time(path), **asked})
    emsid.write_record(found.record, folder / "design.csv")
    return design_report(found)


MAKERS: dict[str, Callable[[Path, Mapping[str, Any], Path], Report]] = {
    "control": _control,
    "compensate": _compensate,
    "design": _design,
}
"""What is made of a model: of its file and options, into a folder."""


def made(path: Path, what: str, asked: Mapping[str, Any], folder: Path) -> Report:
    """A controller, a compensation or a design; its page.

    Args:
        path: the model file.
        what: a key of `MAKERS`.
        asked: numbers by the names of the arguments of `emsid.control`, `emsid.compensate` and `emsid.design`; others
            are texts. Empty ones are left out.
        folder: of the files.

    Raises:
        DataError: for something else.
        EmsidError: where it cannot be made.
    """
    if what not in MAKERS:
        raise DataError(f"{what} is none of {', '.join(MAKERS)}")
    return MAKERS[what](
        path, {name: _number(value) for name, value in asked.items() if value not in ("", None)}, folder
    )


def _number(value: Any) -> Any:
    try:
        return float(value)
    except ValueError:
        return value
