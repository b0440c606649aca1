r"""Park's transformation: voltages and currents of three phases in the frame of the rotor.

    x_d =  2/3·[a·cos φ + b·cos(φ − 2π/3) + c·cos(φ + 2π/3)],
    x_q = −2/3·[a·sin φ + b·sin(φ − 2π/3) + c·sin(φ + 2π/3)],      φ = p·θ, or θ if it is electrical.

With the factor 2/3 the amplitude stays that of a phase; with √(2/3) the power does (`power_invariant`), and numbers of
both axes are larger by √(3/2). The plants have amplitudes, so a log with power-invariant axes is divided by √(3/2).

In the right frame the axes change as slowly as the speed. In a wrong one – the angle is electrical and taken for a
mechanical one, counts backward, or the other way round – they turn, so that little is left of their means over a turn.

References:
    Park, AIEE Transactions 48 (1929). IEC 60050-411 on the axes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError, listed
from emsid.record import Record

Array = NDArray[np.float64]

MORE = 4.0
"""A convention is wrong where the means over a turn keep this many times as much of the mean square in another one."""


def park(
    record: Record,
    phases: Mapping[str, Sequence[str]],
    angle: str,
    pole_pairs: int,
    *,
    electrical: bool = False,
    offset: float = 0.0,
    power_invariant: bool = False,
) -> Record:
    """A record with the phases of a brushless motor replaced by d- and q-axis; the angle becomes one of the shaft.

    Args:
        record: with phases and angle among its inputs or outputs.
        phases: by letter, such as ``{"i": ("ia", "ib", "ic"), "v": ("va", "vb", "vc")}``; ``i_d`` and ``i_q`` take the
            place of the first. Of two names the third phase is minus their sum. Values that are axes already, in
            a pair with ``power_invariant``, are not transformed: leave them out here and divide by √(3/2).
        angle: its name; in rad.
        pole_pairs: p.
        electrical: whether the angle is electrical, so that it turns p times per turn of the shaft.
        offset: the electrical angle in rad at which the d-axis is that of phase a.
        power_invariant: whether the phases were scaled for power-invariant axes, by √(2/3) rather than 2/3.

    Raises:
        DataError: for unknown names, phases on different sides of the record, or another convention that the
            currents fit much better.
    """
    names = (*record.input_names, *record.output_names)
    whole = np.column_stack([record.input, record.output])
    wanted = [angle, *(name for some in phases.values() for name in some)]
    missing = [name for name in wanted if name not in names]
    if missing:
        raise DataError(f"{record.name}: no channel {missing[0]!r}; there are {listed(names)}")
    found_axes, shaft = transformed(
        record.name,
        {letter: whole[:, [names.index(each) for each in some]] for letter, some in phases.items()},
        whole[:, names.index(angle)], pole_pairs,
        electrical=electrical, offset=offset, power_invariant=power_invariant,
    )  # fmt: skip
    columns: dict[str, tuple[str, str, Array]] = {}
    for letter, some in phases.items():
        unit = (*record.input_units, *record.output_units)[names.index(some[0])]
        d, q = found_axes[letter].T
        columns |= dict.fromkeys(some[2:], ("", "", d))
        columns |= {some[0]: (f"{letter}_d", unit, d), some[1]: (f"{letter}_q", unit, q)}
    columns[angle] = (angle, "rad", shaft)
    sides: dict[str, Any] = {}
    for side, own, units in (
        ("input", record.input_names, record.input_units),
        ("output", record.output_names, record.output_units),
    ):
        kept = dict(zip(own, units, strict=True))
        found = [columns.get(name, (name, unit, whole[:, names.index(name)])) for name, unit in kept.items()]
        found = [each for each in found if each[0]]
        sides |= {
            side: np.column_stack([each[2] for each in found]),
            f"{side}_names": tuple(each[0] for each in found),
            f"{side}_units": tuple(each[1] for each in found),
        }
    return replace(record, **sides, signals={})


def transformed(
    label: str,
    phases: Mapping[str, Array],
    theta: Array,
    pole_pairs: int,
    *,
    electrical: bool = False,
    offset: float = 0.0,
    power_invariant: bool = False,
) -> tuple[dict[str, Array], Array]:
    """(N, 2) d- and q-axis of some phases (N, 2 or 3), by letter, and the angle (N,) of the shaft without wraps.

    Args:
        label: of the record, for messages.
        phases: by letter; of two the third is minus their sum.
        theta: (N,) the angle in rad.
        pole_pairs, electrical, offset, power_invariant: as for `park`.

    Raises:
        DataError: where another convention fits much better.
    """
    whole: Array = np.asarray(np.unwrap(theta), dtype=np.float64)
    measured = {letter: _three(values) for letter, values in phases.items()}
    _check(label, measured, whole, pole_pairs, electrical, offset)
    phase = whole * (1 if electrical else pole_pairs) - offset
    scale = sqrt(3 / 2) if power_invariant else 1.0
    found = {letter: axes(values, phase) * scale for letter, values in measured.items()}
    return found, whole / (pole_pairs if electrical else 1)


def axes(abc: Array, phase: Array) -> Array:
    """(N, 2) d- and q-axis of three phases (N, 3) at an electrical angle (N,), with the amplitude of a phase."""
    turned = phase[:, None] - 2 * pi / 3 * np.array([0.0, 1.0, 2.0])
    return np.column_stack([np.sum(abc * np.cos(turned), axis=1), -np.sum(abc * np.sin(turned), axis=1)]) * 2 / 3


def _three(values: Array) -> Array:
    return values if values.shape[1] == 3 else np.column_stack([values, -values.sum(axis=1)])


def _check(
    label: str, measured: Mapping[str, Array], theta: Array, pairs: int, electrical: bool, offset: float
) -> None:
    """Refuse a convention whose axes turn, where those of another one do not."""
    ways = {"electrical": 1.0, "mechanical": float(pairs)}
    ways |= {f"{way} and counts backward": -factor for way, factor in ways.items()}
    given = "electrical" if electrical else "mechanical"
    turned = np.sqrt(np.mean(np.diff(theta) ** 2)) * (pairs - 1)  # of a wrong frame against the right one
    samples = int(np.clip(np.ceil(2 * pi / max(turned, 1e-12)), 2, max(len(theta) // 4, 2)))
    whole = len(theta) // samples * samples
    for letter, abc in measured.items():
        kept = {}
        for way, factor in ways.items():
            found = axes(abc, theta * factor - offset)[:whole]
            means = found.reshape(-1, samples, 2).mean(axis=1)
            kept[way] = float(np.mean(means**2) / max(np.mean(found**2), 1e-300))
        best = max(kept, key=lambda way: kept[way])
        if pairs > 1 and kept[best] > MORE * kept[given]:
            raise DataError(
                f"{label}: in the frame of an angle that is {given}, means over {samples} samples keep "
                f"{100 * kept[given]:.3g} % of the power of {letter}; of one that is {best}, {100 * kept[best]:.3g} %; "
                "correct the angle, or say which it is",
                arguments=("electrical_angle", "pole_pairs"),
            )
