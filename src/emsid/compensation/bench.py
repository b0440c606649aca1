"""A compensation on the virtual bench: a plain PI loop, before and after, and with parameters that are wrong.

The plant is the model itself, with its sticking. A controller reads an incremental encoder and forms the speed from the
difference of two counts; its command is limited and acts a whole number of samples later. The loop tracks a slow sine
through zero and small steps. Errors are those of the true speed.

The PI gains are not tuned: with the inertia M, damping D and force per volt f of the linear part and its time constant
τ = M/D, the closed loop is given the time constant λ = τ, but at least five delays, by Kp = M/(f·(λ + delay)) and the
integral time min(τ, 4λ) (Rivera, Morari, Skogestad, Internal model control 4: PID controller design, 1986; Skogestad,
J. Process Control 13, 2003).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from math import inf, isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.compensation.inverse import Compensation
from emsid.errors import ModelError
from emsid.models.starting import start

Array = NDArray[np.float64]

REVERSAL = 0.25
"""The part of the amplitude below which a reference is in its reversal."""
MOVING = 0.02
"""The part of the amplitude above which a reference moves, so that a plant at rest is stuck."""
WRONG = 0.2
"""The error of the parameters of a wrong model."""
DELAYS = 5.0
"""The shortest time constant of the loop, in delays."""
TIMES, LEAST_SAMPLES, MOST_SAMPLES = 40.0, 400, 20_000
"""A period of the sine in time constants, and the fewest and the most samples of it."""
COUNTS = 10.0
"""Counts of the encoder in a sample at the largest reference speed."""


@dataclass(frozen=True)
class Setting:
    """The bench.

    Attributes:
        amplitude: of the reference, in rad/s (m/s).
        period: of the sine in s.
        resolution: of the encoder, in rad (m).
        delay: in samples.
        limit: largest command.
        proportional, integral: gains of the loop, in V per rad/s and V per rad.
    """

    amplitude: float
    period: float
    resolution: float
    delay: int
    limit: float
    proportional: float
    integral: float


@dataclass(frozen=True, eq=False)
class Run:
    """A run of the loop.

    Attributes:
        reference, speed, command: (N,) each; the true speed.
        rmse: of the true speed in the reversals (of steps: everywhere), in rad/s (m/s).
        stuck: time at rest while the reference moves, in s.
    """

    reference: Array
    speed: Array
    command: Array
    rmse: float
    stuck: float


@dataclass(frozen=True, eq=False)
class Trial:
    """What a compensation changes.

    Attributes:
        setting: the bench.
        dt: sample time in s.
        before, after: runs by the name of the reference, ``sine`` and ``steps``.
        wrong: the same for every combination of factors of friction, dead zone and inertia.
    """

    setting: Setting
    dt: float
    before: dict[str, Run]
    after: dict[str, Run]
    wrong: dict[tuple[float, float, float], dict[str, Run]]

    def gain(self, reference: str) -> float:
        """How many times smaller the error is with the compensation."""
        return self.before[reference].rmse / max(self.after[reference].rmse, 1e-300)

    def worst(self, reference: str) -> Run:
        """The run with the largest error among the wrong models."""
        return max((runs[reference] for runs in self.wrong.values()), key=lambda run: run.rmse)

    def to_data(self) -> dict[str, Any]:
        """The table in built-in types."""
        found = {}
        for name in self.before:
            runs = {"before": self.before[name], "after": self.after[name], "wrong": self.worst(name)}
            found[name] = {kind: {"rmse": run.rmse, "stuck": run.stuck} for kind, run in runs.items()}
        return found


def setting(
    compensation: Compensation, *, limit: float | None = None, delay: int = 1, amplitude: float | None = None
) -> Setting:
    """The bench for a plant, from its own sizes.

    The amplitude is the speed at which the linear part needs the voltage that dead zone and break-away take, so that
    both matter alike.

    Args:
        compensation: of the model.
        limit: the largest command; by default that of the drive, or twice what the reference needs.
        delay: in samples.
        amplitude: of the reference.

    Raises:
        ModelError: for a limit below what it takes to move, or a plant without dead zone and friction, which has no
            speed of its own, where no amplitude is given.
    """
    inside, dt = compensation.inside, compensation.dt
    per_volt = inside.after * inside.before
    zone = compensation.zone
    jump = max(zone.b_r, -zone.b_l) * zone.m_r + float(np.max(compensation.friction.breakaway)) / per_volt
    damping = inside.braking + inside.viscous + float(np.max(compensation.friction.viscous))
    tau = inside.mass / damping if damping > 0 else inf
    if amplitude is None:
        if not jump > 0:
            raise ModelError(f"{compensation.name} has neither dead zone nor friction: there is nothing to compensate")
        amplitude = jump * per_volt / damping if damping > 0 else jump * per_volt / inside.mass
    if not (isfinite(amplitude) and amplitude > 0):
        raise ModelError(f"an amplitude of {amplitude!r}; give a positive speed", arguments=("amplitude",))
    tau = min(tau, MOST_SAMPLES * dt / TIMES)
    loop = max(tau, DELAYS * (delay + 1) * dt)
    proportional = inside.mass / (per_volt * (loop + delay * dt))
    samples = int(min(max(TIMES * tau / dt, LEAST_SAMPLES), MOST_SAMPLES))
    speed = amplitude * np.sin(2 * np.pi * np.arange(samples) / samples)
    need = float(np.max(np.abs(compensation.feedforward(speed))))
    supply = float(compensation.outer.drive[4]) / abs(float(compensation.outer.drive[0]))
    most = min(limit if limit is not None else (supply if isfinite(supply) else 2 * need), supply)
    if need > most:
        raise ModelError(
            f"a limit of {most:.4g} is below the {need:.4g} that a speed of {amplitude:.4g} takes; raise it, or give a "
            "smaller amplitude",
            arguments=("limit", "amplitude"),
        )
    return Setting(
        amplitude, samples * dt, amplitude * dt / COUNTS, delay, most, proportional, proportional / min(tau, 4 * loop)
    )


def try_out(model: Any, compensation: Compensation, on: Setting, wrong: float = WRONG) -> Trial:
    """Run the loop before and after, and with models whose parameters are wrong by this factor either way.

    Args:
        model: the plant, or a fit of it.
        compensation: of the model.
        on: the bench.
        wrong: error of friction, dead zone and inertia, in all eight combinations.
    """
    references = {"sine": _sine(on, compensation.dt), "steps": _steps(on, compensation.dt)}
    before = {name: _run(model, None, compensation, on, *reference) for name, reference in references.items()}
    after = {name: _run(model, compensation, compensation, on, *reference) for name, reference in references.items()}
    off: dict[tuple[float, float, float], dict[str, Run]] = {}
    ends = (1 - wrong, 1 + wrong)
    for factors in product(ends, ends, ends):
        other = compensation.scaled(*factors)
        off[factors] = {
            name: _run(model, other, compensation, on, *reference) for name, reference in references.items()
        }
    return Trial(on, compensation.dt, before, after, off)


def _sine(on: Setting, dt: float) -> tuple[Array, NDArray[np.bool_]]:
    """Two periods, and where they are counted: in the reversals after the first quarter."""
    samples = round(on.period / dt)
    phase = 2 * np.pi * np.arange(2 * samples) / samples
    reference = on.amplitude * np.sin(phase)
    return reference, (np.abs(reference) < REVERSAL * on.amplitude) & (np.arange(len(phase)) > samples // 4)


def _steps(on: Setting, dt: float) -> tuple[Array, NDArray[np.bool_]]:
    """Small steps through zero, each an eighth of a period."""
    hold = max(round(on.period / dt / 8), 1)
    levels = on.amplitude * np.array([0.0, 0.1, -0.1, 0.2, -0.2, 0.05, -0.05, 0.0])
    reference = np.repeat(levels, hold)
    return reference, np.ones(len(reference), dtype=bool)


def _run(
    model: Any, used: Compensation | None, known: Compensation, on: Setting, reference: Array, counted: Any
) -> Run:
    """The loop over a reference, with a compensation or none."""
    dt, n = known.dt, len(reference)
    sampler = getattr(start(model, dt=dt), "sampler", None)
    assert sampler is not None  # a plant that has an inverse has one
    gain, offset = known.outer.drive[:2].tolist()
    then = np.append(reference[1:], reference[-1])
    fed = np.zeros(n) if used is None else used.wanted(reference, then)
    late, y = [-offset] * on.delay, np.empty(len(known.outer.signals))
    speeds, commands, u = np.empty(n), np.empty(n), np.empty(1)
    count, total = 0.0, 0.0
    for k, wanted_speed in enumerate(reference.tolist()):
        motion = sampler.state.motion.tolist()  # speed and position first, behind a shaft those of the load
        speeds[k], position = motion[:2] if len(motion) < 5 else (motion[2], motion[4])
        counts = float(np.floor(position / on.resolution))
        error, count = wanted_speed - (counts - count) * on.resolution / dt, counts
        wanted = fed[k] + on.proportional * error + on.integral * total
        free = float(used.command(wanted)) if used is not None else wanted / gain - offset
        commands[k] = min(max(free, -on.limit), on.limit)
        if commands[k] == free:  # the integral waits while the command is limited
            total += error * dt
        late.append(float(commands[k]))
        u[0] = late.pop(0)
        sampler.advance(u, y)
    rmse = float(np.sqrt(np.mean((speeds - reference)[counted] ** 2)))
    stuck = dt * int(np.count_nonzero((speeds == 0) & (np.abs(reference) > MOVING * on.amplitude)))
    return Run(reference, speeds, commands, rmse, stuck)
