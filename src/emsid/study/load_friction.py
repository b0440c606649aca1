"""Friction on the load side: what it costs to use a linear–static–linear structure.

The paper neglects this friction because the outputs with and without it differ by a mean square of 3.3e-6 (section
V.A). That number says how small the friction is, not whether the structure suits the motor. So the structure is fitted
at several levels of friction, from none to a tenth of the rotor's, and its free-run error on unseen data is compared
with that without load friction. The structure stops being fair where the error is larger by more than noise, by the
same rule by which cascades are chosen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from emsid.estimation.nonlinear.control import FREE, Control
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.fitting import fit_cascade
from emsid.plant import Bench, Friction, Motor
from emsid.record import Record
from emsid.selection.improvement import StretchErrors, better
from emsid.study.setup import IDENTIFICATION, UNSEEN, Settings, measure

SHARES = (0.0, 0.002, 0.005, 0.01, 0.02, 0.035, 0.05, 0.075, 0.1)
"""Coulomb friction of the load as a fraction of the rotor's."""

FITTED = (0.0, 0.05, 0.1)
"""Where the blocks are fitted."""

# The search starts from the fitted blocks of the study.
_ITERATIONS = 5


@dataclass(frozen=True)
class LoadFriction:
    """Effect of friction on the load, from none to a tenth of the rotor's.

    Attributes:
        shares: friction of the load over that of the rotor.
        differences: mean square difference to the output without it, on unseen data.
        fitted: where the blocks were fitted, as shares.
        errors: free-run MSE of the blocks there, on unseen data.
        unfair_from: the first share where their error is larger than without load friction by more than noise; None if
            there is none.
        visible_from: the share at which the difference of the outputs is as large as the error of the blocks; None if
            it stays smaller.
    """

    shares: tuple[float, ...]
    differences: tuple[float, ...]
    fitted: tuple[float, ...]
    errors: tuple[float, ...]
    unfair_from: float | None
    visible_from: float | None


def rotor_level(motor: Motor) -> float:
    """The mean Coulomb level of the rotor in N·m; 0 for another law of friction."""
    law = motor.rotor_friction
    return (law.forward.coulomb + law.backward.coulomb) / 2 if isinstance(law, Friction) else 0.0


def load_friction(settings: Settings, blocks: Cascade, control: Control = FREE) -> LoadFriction | None:
    """The curve of a motor; None without Coulomb friction of the rotor, or where a free run diverges.

    Args:
        settings: motor and records; they have no noise here.
        blocks: the cascade of the study, which every fit starts from.
        control: when to stop.
    """
    level = rotor_level(settings.motor)
    if not level > 0 or control.ending:
        return None
    differences: list[float] = []
    errors: list[StretchErrors] = []
    without: Record | None = None
    for k, share in enumerate(SHARES):
        control.doing("friction on the load", k, len(SHARES))
        unseen = _record(settings, share * level, UNSEEN)
        without = without or unseen
        differences.append(float(np.mean((unseen.output - without.output) ** 2)))
        if share in FITTED:
            fit = fit_cascade(blocks, _record(settings, share * level, IDENTIFICATION), max_iterations=_ITERATIONS)
            squares = np.sum((unseen.output - fit.model.simulate(unseen).output) ** 2, axis=1)
            errors.append(StretchErrors.of(squares[fit.model.memory :]))
    if not all(np.isfinite(error.mean) for error in errors):
        return None
    unfair = (share for share, error in zip(FITTED, errors, strict=True) if better(errors[0], error))
    means = [error.mean for error in errors]
    return LoadFriction(
        SHARES, tuple(differences), FITTED, tuple(means), next(unfair, None), _crossing(differences, means)
    )


def _record(settings: Settings, level: float, kind: str) -> Record:
    motor = replace(settings.motor, load_friction=Friction(level))
    return measure(replace(settings, motor=motor), Bench(), kind, np.random.default_rng(settings.seed))


def _crossing(differences: list[float], errors: list[float]) -> float | None:
    """The share at which the difference reaches the error of the blocks; both grow with the square of the share."""
    reached = np.interp(SHARES, FITTED, errors)
    above = np.flatnonzero(np.array(differences) >= reached)
    if not len(above):
        return None
    k = int(above[0])
    return float(SHARES[k] * np.sqrt(reached[k] / differences[k]))
