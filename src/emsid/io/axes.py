"""Columns of the phases of a brushless motor in the frame of its rotor, as further columns of the file.

``phases={"v": "va,vb,vc", "i": "ia,ib"}`` adds ``v_d``, ``v_q``, ``i_d`` and ``i_q``, and ``rotor``, the angle of the
shaft in rad without its wraps. The axes have the amplitude of a phase (`emsid.models.plants.park`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from emsid.errors import DataError
from emsid.findings import Finding
from emsid.io.columns import Columns, as_numbers
from emsid.io.selection import check_column
from emsid.models.plants.park import transformed
from emsid.units import conversion

ROTOR = "rotor"
"""The column of the angle of the shaft."""


def with_axes(
    columns: Columns,
    phases: Mapping[str, str],
    angle: str | None,
    pole_pairs: float | None,
    electrical: bool,
    power_invariant: bool,
    units: Mapping[str, str],
    label: str,
) -> tuple[Columns, list[Finding]]:
    """The columns of a file with those of the axes, and a finding where these data cannot check the convention.

    Args:
        columns: of the file.
        phases: by the letter of the axes, two or three columns with commas between.
        angle: the column of the angle, in rad or in the unit that ``units`` or the file gives.
        pole_pairs: p.
        electrical: whether the angle is electrical.
        power_invariant: whether the phases were scaled for power-invariant axes.
        units: by column.
        label: of the file, for messages.

    Raises:
        DataError: for phases without an angle or pole pairs, names that the file has already or does not have, and
            a convention that the phases contradict.
    """
    import polars as pl

    if not phases:
        return columns, []
    if angle is None or pole_pairs is None or pole_pairs != round(pole_pairs) or pole_pairs < 1:
        raise DataError(
            "phases need the column of the rotor's angle and the number of pole pairs, at least 1",
            arguments=("rotor_angle", "pole_pairs"),
        )
    names = {letter: [columns.called(each.strip()) for each in text.split(",")] for letter, text in phases.items()}
    place = columns.called(angle)
    for name in [place, *(each for some in names.values() for each in some)]:
        check_column(name, columns)
    few = next((letter for letter, some in names.items() if len(some) not in (2, 3)), None)
    if few is not None:
        raise DataError(f"phases {few}={phases[few]}: give two or three columns", arguments=("phases",))
    new = [f"{letter}_{axis}" for letter in names for axis in "dq"] + [ROTOR]
    taken = next((name for name in new if name in columns.series), None)
    if taken is not None:
        raise DataError(f"there is a column {taken!r} already; leave phases out", arguments=("phases",))
    unit = next((units[each] for each in (angle, place) if each in units), "") or columns.unit(place) or "rad"
    theta = as_numbers(columns.series[place]) * conversion(unit, "rad").gain
    values = {
        letter: np.column_stack([as_numbers(columns.series[each]) for each in some]) for letter, some in names.items()
    }
    known = np.isfinite(np.column_stack([theta, *values.values()])).all(axis=1)
    if np.count_nonzero(known) < 2:
        raise DataError("phases and angle have no rows in common", arguments=("phases",))
    found, shaft, notes = transformed(
        label, {letter: each[known] for letter, each in values.items()}, theta[known], int(pole_pairs),
        electrical=electrical, power_invariant=power_invariant,
    )  # fmt: skip
    series, given = dict(columns.series), dict(columns.units)

    def add(name: str, part: np.ndarray, unit: str) -> None:
        whole = np.full(len(theta), np.nan)
        whole[known] = part
        series[name], given[name] = pl.Series(name, whole).fill_nan(None), unit

    for letter, both in found.items():
        for axis, part in zip("dq", both.T, strict=True):
            add(f"{letter}_{axis}", part, units.get(names[letter][0], "") or columns.unit(names[letter][0]))
    add(ROTOR, shaft, "rad")
    return replace(columns, series=series, units=given), notes
