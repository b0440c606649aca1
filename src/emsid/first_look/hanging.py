"""An angle that hangs: one on which gravity acts, so that it returns to an angle of its own when nothing drives it.

Gravity turns an arm against sin(θ − θ₀), a wave over the angle with one period per turn. The angle hangs where such a
wave explains much of its acceleration beside command, damping and friction. Where the unit of the angle is not known,
neither is a turn in it; the length of the wave that explains most shows it, if the arm swings so far that a wave and a
spring differ.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import atan2, hypot, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from emsid.findings import Finding
from emsid.first_look.baseline import middle
from emsid.first_look.examined import Examined, is_position
from emsid.first_look.levels import EXPLAINS, PART, SAMPLES
from emsid.first_look.names import ColumnQuantity, meaning
from emsid.models.plants.motion_regression import motion_rows, solved, waves
from emsid.record import Record

Array = NDArray[np.float64]

HANGING, FEWEST = 8.0, 200
"""An angle hangs where, of at least this many samples in motion, filtered with this time constant in samples, the waves
of gravity leave less than half of the acceleration that a motor without them leaves, and less than half of all. A turn
of unknown length is one that leaves less than half of what a spring leaves."""
RATIOS = np.geomspace(0.6, 30.0, 40)
"""Lengths of a turn that are tried, over the range of the angle; the longest is as straight as a spring."""
TURNS = {"deg": 360.0, "rad": 2 * pi}


@dataclass(frozen=True)
class Hanging:
    """An angle that hangs.

    Attributes:
        angle: at which it hangs, in its unit.
        turn: one turn in its unit.
        period: of small swings, in s.
        unit: that it seems to have, where it has none: ``deg``, ``rad``, or empty for ticks.
    """

    angle: float
    turn: float
    period: float
    unit: str = ""


def hanging(record: Record) -> Hanging | None:
    """How the first output hangs; None for one that does not, and for a position that is no angle.

    Targets of a position show no gravity: the controller holds the angle like a spring.
    """
    unit = next(iter(record.output_units), "")
    if unit not in ("rad", "") or not is_position(record) or _is_target(record):
        return None
    few = middle(record, SAMPLES)
    segments = [segment for segment in few.segments if len(segment) > 2 * HANGING]
    span = float(np.ptp(few.output)) if segments else 0.0
    if not (span > 0 and np.ptp(few.input) > 0):
        return None

    motion = _Motion.of(segments)
    if len(motion.right) < FEWEST or not motion.total > 0:
        return None
    tried = motion.with_turn
    if unit:
        return tried(TURNS["rad"])[1]
    from scipy.optimize import minimize_scalar  # for an angle without a unit only

    shares = [tried(ratio * span)[0] for ratio in RATIOS]
    best = int(np.argmin(shares))
    near = np.log(span * RATIOS[[max(best - 1, 0), min(best + 1, len(RATIOS) - 1)]])
    refined = minimize_scalar(lambda log: tried(np.exp(log))[0], bounds=near, method="bounded")
    turn = float(np.exp(refined.x))
    share, found = tried(turn)
    if found is None or not share < EXPLAINS * shares[-1]:
        return None
    said = next((name for name, known in TURNS.items() if abs(turn / known - 1) < PART), "")
    return Hanging(found.angle, turn, found.period, said)


def _is_target(record: Record) -> bool:
    """Whether the first input is a position or a target of one."""
    said = meaning(record.input_names[0], record.input_units[0]).quantity
    return said in (ColumnQuantity.REFERENCE, ColumnQuantity.POSITION) or record.input_units[0] == "rad"


@dataclass(frozen=True, eq=False)
class _Motion:
    """The samples in motion of an angle, for waves of any length.

    Attributes:
        angles: of every segment, all samples.
        kept: of every segment, those in motion.
        columns, right: the regression without waves.
        total, plain: the squared acceleration, and the share of it that is left without waves.
    """

    angles: list[Array]
    kept: list[NDArray[np.bool_]]
    columns: Array
    right: Array
    total: float
    plain: float

    @classmethod
    def of(cls, segments: list[Record]) -> _Motion:
        """The motion in some segments."""
        tables, kept = zip(*(motion_rows(each, 0, True, HANGING, 0.0, 0.0) for each in segments), strict=True)
        table = np.concatenate(tables)
        columns, right = table[:, :-1], table[:, -1]
        total = float(right @ right)
        plain = _left(columns, right, solved(columns, right)) / total if total > 0 else 1.0
        return cls([each.output[:, 0] for each in segments], list(kept), columns, right, total, plain)

    def with_turn(self, turn: float) -> tuple[float, Hanging | None]:
        """The share of the acceleration that is left with waves of this length, and how the angle hangs in them."""
        phase = 2 * pi / turn
        pairs = zip(self.angles, self.kept, strict=True)
        columns = np.hstack([self.columns, np.concatenate([waves(x, HANGING, phase)[own] for x, own in pairs])])
        values = solved(columns, self.right)
        left = _left(columns, self.right, values) / self.total
        cosine, sine = values[-2:]  # cosine·cos + sine·sin against the motion is sin(θ − θ₀)
        size = hypot(cosine, sine)
        if not (left < EXPLAINS * min(self.plain, 1.0) and size > 0):
            return left, None
        angle = turn / (2 * pi) * atan2(-cosine, sine)
        middle_of = float(np.mean([np.mean(each) for each in self.angles]))
        angle += turn * round((middle_of - angle) / turn)
        return left, Hanging(angle, turn, 2 * pi / sqrt(size * phase))


def _left(columns: Array, right: Array, values: list[float]) -> float:
    """What a regression leaves, squared."""
    return float(np.sum((right - columns @ np.array(values)) ** 2))


def as_angle(record: Record) -> dict[str, str] | None:
    """The unit to read a hanging angle with, by its name; empty where that is known or open, None where none hangs."""
    found = hanging(record)
    if found is None:
        return None
    return {record.output_names[0]: found.unit} if found.unit and not record.output_units[0] else {}


def hangs(data: Examined) -> Iterable[Finding]:
    """Whether the angle hangs, what one load cannot separate then, and whether its unit is missing."""
    record = data.record
    found = hanging(record)
    if found is None:
        return
    unit = record.output_units[0]
    shown = data.y.min() <= found.angle <= data.y.max()  # small swings hardly show where they would end
    shared = {"angle": found.angle if shown else None, "unit": unit, "period": found.period}
    yield Finding("angle-hangs", data.output, shared)
    if not unit:
        yield Finding("angle-without-unit", data.output, {"turn": found.turn, "seems": found.unit})
    given = record.input_units[0]
    if given != "N*m" and meaning(data.input, given).quantity is not ColumnQuantity.TORQUE:
        yield Finding("one-load", data.input, {"output": data.output})
