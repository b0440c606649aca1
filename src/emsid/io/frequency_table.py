"""Frequency responses as tables: of this program, of analysers, and of the Bode plots of oscilloscopes.

A table has a column of frequencies, and for every path magnitude and phase, or real and imaginary part; their headers
say in which unit: Hz, kHz or rad/s; dB or a ratio; degrees or radians. Without a unit, a magnitude called gain or in dB
is in dB if it is ever negative, and a phase is in degrees if it is ever beyond ±7.
"""

from __future__ import annotations

import json
import os
import re
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError, FormatError
from emsid.io.columns import Columns, as_numbers, errors_of
from emsid.io.files import atomic_write
from emsid.io.reading import read_columns
from emsid.record import FrequencyResponse

Array = NDArray[np.float64]

KINDS = {
    "frequency": re.compile(r"freq|^f$|^f \[|\bhz\b|omega|^w$"),
    "coherence": re.compile(r"coh|gamma|γ"),
    "real": re.compile(r"\bre(al)?\b|_re\b"),
    "imaginary": re.compile(r"\bim(ag|aginary)?\b|_im\b"),
    "phase": re.compile(r"phase|phas|°|\bdeg|angle|arg"),
    "deviation": re.compile(r"deviation"),
    "noise": re.compile(r"noise"),
    "even": re.compile(r"^even"),
    "distortion": re.compile(r"distortion"),
    "magnitude": re.compile(r"magn|gain|\bmag\b|\bdb\b|\|h\||\|g\||ratio"),
    "amplitude": re.compile(r"ampl"),
}
"""What a column is, by its name in lower case; the first that is found counts."""
MARK = "emsid frequency response "
MOST_TURN = 7.0
"""A phase without a unit that is larger anywhere is in degrees: seven is more than a turn in radians."""


class _About(msgspec.Struct):
    """What a table cannot say in columns."""

    dt: float | None = None
    inputs: list[tuple[str, str]] = []
    outputs: list[tuple[str, str]] = []
    realisations: int = 1
    overlap: float = 1.0
    method: str = "table"


def write_frequency_response(response: FrequencyResponse, path: str | os.PathLike[str]) -> None:
    """Write a frequency response as a CSV table of frequency, magnitude in dB, phase in degrees, and what else it has.

    Its first line is a comment with sample time, channels and units.

    Args:
        response: to write.
        path: the file.

    Raises:
        FormatError: where the file cannot be written.
    """
    channels = {
        f"{side}s": list(zip(getattr(response, f"{side}_names"), getattr(response, f"{side}_units"), strict=True))
        for side in ("input", "output")
    }
    about = {key: getattr(response, key) for key in ("dt", "realisations", "overlap", "method")} | channels
    columns = response.columns()
    names = [f"{name} [{unit}]" if (unit := _unit_of(name)) else name for name in columns]
    rows = [",".join(repr(float(value)) for value in row) for row in zip(*columns.values(), strict=True)]
    atomic_write(Path(path), "\n".join([f"# {MARK}{json.dumps(about)}", ",".join(names), *rows, ""]))


def _unit_of(name: str) -> str:
    kind = name.split("_")[0]
    return {"frequency": "Hz", "phase": "deg", "coherence": "1"}.get(kind, "dB")


def read_frequency_response(path: str | os.PathLike[str]) -> FrequencyResponse:
    """Read a table of a frequency response, which this program, an analyser or an oscilloscope wrote.

    Args:
        path: the file: text, a spreadsheet, or any table that `emsid.read` reads.

    Raises:
        FormatError: where the file cannot be read, or has no columns of frequency, magnitude and phase.
    """
    path = Path(path)
    columns = read_columns(path)
    by_kind: dict[str, list[tuple[str, Array]]] = {}
    for name, series in columns.series.items():
        label = f"{name} {columns.units.get(name, '')}".lower()
        kind = next((kind for kind, pattern in KINDS.items() if pattern.search(label)), None)
        if kind is not None and series.dtype.is_numeric():
            by_kind.setdefault(kind, []).append((label, as_numbers(series)))
    by_kind.setdefault("magnitude", by_kind.get("amplitude", []))  # an oscilloscope also shows that of its generator
    about = _about(columns)
    with errors_of(path):
        pairs = (("magnitude", "phase"), ("real", "imaginary"))
        if not by_kind.get("frequency") or not any(all(by_kind.get(kind) for kind in pair) for pair in pairs):
            raise FormatError(
                "there is no frequency response in this table: it needs columns of frequency, magnitude and phase, or "
                f"of real and imaginary part; there are {', '.join(map(repr, columns.series))}"
            )
        label, frequency = by_kind["frequency"][0]
        frequency = frequency * _factor(label)
        if "real" in by_kind and "imaginary" in by_kind:
            parts = zip(by_kind["real"], by_kind["imaginary"], strict=False)
            paths = [real + 1j * imaginary for (_, real), (_, imaginary) in parts]
        else:
            parts = zip(by_kind["magnitude"], by_kind["phase"], strict=False)
            paths = [_ratio(*magnitude) * np.exp(1j * _radians(*phase)) for magnitude, phase in parts]
        known = np.isfinite(frequency) & np.isfinite(np.array(paths)).all(axis=0)
        order = np.flatnonzero(known)[np.argsort(frequency[known], kind="stable")]
        order = order[np.append(True, np.diff(frequency[order]) > 0)]  # a frequency twice: the first counts
        outputs, inputs = max(len(about.outputs), 1), max(len(about.inputs), 1)
        if outputs * inputs != len(paths):
            outputs, inputs = len(paths), 1
        shape = (len(order), outputs, inputs)
        found: dict[str, Any] = {
            field: np.array([10 ** (values[order] / 10) for _, values in by_kind[name]]).T.reshape(shape)
            for field, name in (("total", "deviation"), ("noise", "noise"), ("even", "even"))
            if len(by_kind.get(name, [])) == len(paths)
        }
        if len(by_kind.get("coherence", [])) == outputs:
            found["coherence"] = np.array([values[order] for _, values in by_kind["coherence"]]).T
        for side, several in (("input", about.inputs), ("output", about.outputs)):
            if len(several) == (inputs if side == "input" else outputs):
                found |= {f"{side}_names": tuple(n for n, _ in several), f"{side}_units": tuple(u for _, u in several)}
        try:
            return FrequencyResponse(
                frequency[order],
                np.array([values[order] for values in paths]).T.reshape(shape),
                **found,
                dt=about.dt,
                realisations=about.realisations,
                overlap=about.overlap,
                method=about.method,
                name=path.name,
            )
        except DataError as problem:
            raise FormatError(str(problem)) from None


def _about(columns: Columns) -> _About:
    for line in columns.preamble:
        if line.startswith(MARK):
            try:
                return msgspec.json.decode(line.removeprefix(MARK), type=_About)
            except msgspec.MsgspecError:
                break
    return _About()


def _factor(label: str) -> float:
    """To Hz."""
    if re.search(r"rad|omega|^w\b", label):
        return 1 / (2 * np.pi)
    return next((10.0**power for unit, power in (("mhz", 6), ("khz", 3)) if unit in label), 1.0)


def _ratio(label: str, values: Array) -> Array:
    in_decibels = "db" in label or (bool(np.any(values < 0)) and not re.search(r"ratio|abs|lin", label))
    return np.asarray(10 ** (values / 20) if in_decibels else values)


def _radians(label: str, values: Array) -> Array:
    if re.search(r"\brad", label):
        return values
    in_degrees = re.search(r"deg|°", label) or np.nanmax(np.abs(values), initial=0.0) > MOST_TURN
    return np.asarray(np.radians(values) if in_degrees else values)
