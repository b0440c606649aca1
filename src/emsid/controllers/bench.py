"""The bench: a cascade and usual rules in closed loop with the plant, over the same references.

The plant is the model itself with its sticking, dead zone, drive and inductance. A controller reads a quantised
encoder; its command acts a delay later and is limited. Friction is as identified, 30 % lower and 30 % higher; with a
backlash the encoder is behind it, on a load that friction holds while the motor crosses the gap.

References: **hold** (a short move, then a long rest), **reversal** (a slow sine, counted where it is slow), **step**,
and **sine** (a sine at a fifth of the bandwidth). Beside the cascade run, on the same reference speed,

- symmetric optimum: Kp = M/(2·f·T), T_i = 4·T, position gain 1/(8·T),
- SIMC (Skogestad, J. Process Control 13, 2003): τ_c = T, Kp = M/(2·f·T), T_i = min(M/D, 8·T), position gain 1/(4·T),

- LQR as WPILib makes it: by Bryson's rule for errors as large as the step and the speed of the slow sine and for half
  of what is left of the command, with its compensation of the delay, K·(A − B·K)^(delay/h),

where T is the sum of the delays: that of the command, one and a half samples and the lag of a current loop; and the
cascade without feed-forward and without the compensation of friction and dead zone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import inf, isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.compensation import Compensation
from emsid.controllers.cascade import FRICTION, RunningCascade, Settings
from emsid.controllers.loops import Plants
from emsid.controllers.region import scaled
from emsid.controllers.tuning import by_difference, observer
from emsid.errors import ModelError
from emsid.models.starting import start

Array = NDArray[np.float64]

SLOW = 0.25
"""The part of the largest speed below which a reference is in its reversal."""
TIMES, LEAST_SAMPLES, MOST_SAMPLES = 40.0, 400, 4000
"""A period of the slow sine in time constants of the plant, and the fewest and the most samples of it."""
COUNTS = 10.0
"""Counts in a sample at the largest speed, of an encoder that is not given."""
FACTORS = (1.0 - FRICTION, 1.0 + FRICTION)
"""Friction on the bench, as a multiple of that identified."""
REFERENCES = ("hold", "reversal", "step", "sine")
AS_IS = "as identified"
"""The plant that is the model."""
REST = 1.0
"""Length in s of the rest that is counted."""
CASCADE, BARE, OPTIMUM = "cascade", "cascade without compensation", "symmetric optimum"
SIMC, LQR, FIXED = "SIMC", "LQR", "cascade with a fixed level"
"""The controllers."""
PIECES = 10
"""Pieces of a sample in which a delay that is no multiple of it is counted."""


@dataclass(frozen=True, eq=False)
class BenchRun:
    """A run of a loop.

    Attributes:
        time: (N,) in s.
        reference, actual: (N,) true position in rad (m), without a position loop true speed.
        command: (N,) what the drive gets.
        error: RMS of reference − actual where it is counted.
        overshoot: after a step, as a part of it; NaN elsewhere.
        changes: changes of the sign of the command per second during the rest; NaN elsewhere.
    """

    time: Array
    reference: Array
    actual: Array
    command: Array
    error: float
    overshoot: float
    changes: float


@dataclass(frozen=True, eq=False)
class ControlBench:
    """The bench of a plant.

    Attributes:
        model: the plant.
        dt, delay, current_dt: sample time, delay and sample time of the current loop in s; 0 for no current loop.
        limit: the largest command.
        speed: the largest reference speed of the slow sine in rad/s (m/s).
        period: of the slow sine in s.
        resolution: a count of the encoder in rad (m).
        origin: the position at which every run begins, in rad (m).
        backlash: in rad (m).
        settings: the cascade; None before it is designed.
        plants: the plants of its region.
        whole_delay: delay of the loop with that of the drive in s.
        names: of the controllers that run.
        wrong: what of the plant is 30 % lower and higher than identified: friction, dead zone.
    """

    model: Any
    dt: float
    delay: float
    current_dt: float
    limit: float
    speed: float
    period: float
    resolution: float
    origin: float = 0.0
    backlash: float = 0.0
    settings: Settings | None = None
    plants: Plants | None = None
    whole_delay: float = 0.0
    names: tuple[str, ...] = (CASCADE, BARE, OPTIMUM, SIMC, LQR)
    wrong: tuple[str, ...] = ("friction",)

    @property
    def _designed(self) -> tuple[Settings, Plants]:
        """The cascade and the plants of its region."""
        assert self.settings is not None
        assert self.plants is not None
        return self.settings, self.plants

    @property
    def motion(self) -> tuple[str, str]:
        """What follows the references, position or speed, and its unit."""
        follows = self._designed[0].position > 0
        way = "m" if self.model.name == "linear-axis" else "rad"
        return ("position", way) if follows else ("speed", f"{way}/s")

    @property
    def command_unit(self) -> str:
        """The unit of what the drive gets; none where its gain makes another one of it, as of a duty."""
        return unit_of(self.model) if abs(self._designed[0].gain) == 1 else ""

    @property
    def controllers(self) -> dict[str, Settings]:
        """The cascade and what stands beside it."""
        s, plants = self._designed
        bare = s.feedback_only()
        total = self.whole_delay + 1.5 * s.dt + plants.lag
        gain = float(plants.mass[0] / (2 * plants.force[0] * total))
        tau = float(plants.mass[0] / plants.damping[0]) if plants.damping[0] > 0 else inf
        follows = s.position > 0
        rule = by_difference(Settings(s.dt, 0.0, gain, 0.0, limit=s.limit, gain=s.gain, offset=s.offset), 1.0)
        rule = replace(rule, **{name: getattr(s, name) for name in vars(s) if name.startswith("current_")})
        place, turn = self._quadratic
        return {
            CASCADE: s,
            FIXED: replace(s, adapt=0.0),
            BARE: bare,
            OPTIMUM: replace(rule, integral=gain / (4 * total), position=follows / (8 * total)),
            SIMC: replace(rule, integral=gain / min(tau, 8 * total), position=follows / (4 * total)),
            LQR: replace(rule, proportional=turn, position=follows * place / turn),
        }

    @property
    def _quadratic(self) -> tuple[float, float]:
        """Feedback of position and speed of the LQR, in u per rad (m) and u per rad/s (m/s)."""
        from scipy.linalg import fractional_matrix_power, solve_discrete_are

        s, plants = self._designed
        left, way, faster, further = observer(plants, s.dt, 1.0, 1.0)[0]
        a, b = np.array([[1.0, way], [0.0, left]]), np.array([[further], [faster]])
        sizes = [self._step_height(), self.speed]
        if not s.position > 0:
            a, b, sizes = a[1:, 1:], b[1:], sizes[1:]
        cost, effort = np.diag([1 / size**2 for size in sizes]), np.array([[1 / self._designed[0].spare ** 2]])
        x = solve_discrete_are(a, b, cost, effort)
        k = np.linalg.solve(effort + b.T @ x @ b, b.T @ x @ a)
        k = np.real(k @ fractional_matrix_power(a - b @ k, self.whole_delay / s.dt))
        return float(k[0, 0]), float(k[0, -1])

    @cached_property
    def runs(self) -> dict[tuple[str, str, str], BenchRun]:
        """By controller, reference and plant: ``as identified``, ``friction × 0.7``, ``backlash`` and so on."""
        plants: dict[str, tuple[Any, float]] = {AS_IS: (self.model, 0.0)}
        for what in self.wrong:
            changed = ((factor, scaled(self.model, what, factor)) for factor in FACTORS)
            plants |= {f"{what} × {factor:g}": (model, 0.0) for factor, model in changed if model is not None}
        if self.backlash > 0:
            plants["backlash"] = (self.model, self.backlash)
        return {
            (name, reference, plant): self.run(settings, reference, model, gap)
            for name, settings in self.controllers.items()
            if name in self.names
            for reference in REFERENCES
            for plant, (model, gap) in plants.items()
        }

    @property
    def table(self) -> list[dict[str, Any]]:
        """A row for every run: controller, reference, plant, error, overshoot and changes of sign per second."""
        return [
            {
                "controller": name, "reference": reference, "plant": plant,
                "error": run.error, "overshoot": run.overshoot, "changes": run.changes,
            }
            for (name, reference, plant), run in self.runs.items()
        ]  # fmt: skip

    def to_data(self) -> dict[str, Any]:
        """The bench and its table in built-in types."""
        rows = [{key: None if value != value else value for key, value in row.items()} for row in self.table]
        return {
            "limit": self.limit, "speed": self.speed, "period": self.period, "resolution": self.resolution,
            "backlash": self.backlash, "runs": rows,
        }  # fmt: skip

    def reference(self, name: str) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
        """Position, speed and acceleration (N,) of a reference, and where its error is counted."""
        s, dt = self._designed[0], self.dt
        if name in ("reversal", "sine"):
            fast = name == "sine"
            period = max(5 / max(self._width, 1e-9), 40 * dt) if fast else self.period
            rate = 2 * np.pi / period
            # a fast sine has the speed of the slow one, unless its acceleration takes more than half of the limit
            most = self.speed if not fast else min(self.speed, self._fastest(rate))
            time = dt * np.arange(round(2 * period / dt))
            position = most / rate * (1 - np.cos(rate * time))
            speed, counted = most * np.sin(rate * time), time > period / 4
            if not fast:
                counted &= np.abs(speed) < SLOW * most
            return position, speed, np.append(np.diff(speed), 0.0) / dt, counted
        settle = 5 / max(self._width, 1e-9)
        rest, move = (REST, max(settle, 40 * dt)) if name == "hold" else (0.0, 0.0)
        settle *= 2 if name == "hold" else 1
        time = dt * np.arange(round((move + settle + rest) / dt))
        if name == "hold":  # a smooth move, then rest
            part = np.clip(time / move, 0.0, 1.0)
            distance = 0.5 * min(self.speed, self._fastest(2 * np.pi / move)) * move
            speed = distance / move * (1 - np.cos(2 * np.pi * part)) * (part < 1)
            position = distance * (part - np.sin(2 * np.pi * part) / (2 * np.pi))
            if not s.position > 0:
                speed = speed * (time < move)
            return position, speed, np.append(np.diff(speed), 0.0) / dt, time >= move + settle
        height = self._step_height()
        zero, begun = np.zeros(len(time)), time >= 5 * dt
        if s.position > 0:
            return np.where(begun, height, 0.0), zero, zero, begun
        return zero, np.where(begun, height, 0.0), zero, begun

    @property
    def _width(self) -> float:
        """About the bandwidth in Hz."""
        s, plants = self._designed
        inner = s.proportional * float(plants.force[0] / plants.mass[0])
        return (min(s.position, inner) if s.position > 0 else inner) / (2 * np.pi)

    def _fastest(self, rate: float) -> float:
        """The speed of a sine of this rate whose force takes half of what is left beside friction and dead zone."""
        plants = self._designed[1]
        return float(self._designed[0].spare * plants.force[0] / np.hypot(plants.mass[0] * rate, plants.damping[0]))

    def _step_height(self) -> float:
        """A step whose first command is half of what is left, so that its overshoot is that of the loop."""
        s = self._designed[0]
        return self._designed[0].spare / (s.proportional * (s.position or 1.0))

    def run(self, settings: Settings, name: str, model: Any, backlash: float = 0.0) -> BenchRun:
        """A cascade over a reference.

        Args:
            settings: the cascade.
            name: hold, reversal, step or sine.
            model: the plant.
            backlash: in rad (m).
        """
        wanted, speed, acceleration, counted = self.reference(name)
        current = settings.current_dt > 0
        pieces = max(round(self.dt / self.current_dt), 1) if current else PIECES
        if not current and abs(self.delay / self.dt - round(self.delay / self.dt)) < 1e-9:
            pieces = 1
        h = self.dt / pieces
        sampler: Any = getattr(start(model, dt=h), "sampler", None)
        assert sampler is not None
        cascade, n = RunningCascade(settings), len(wanted)
        designed = RunningCascade(self._designed[0])
        bears = self._designed[0].load + designed.waves(self.origin, 0.0)  # so that the plant begins at rest
        rest = designed.command(bears * (model.parameter_values()["resistance"] if current else 1.0))
        late = [bears if current else rest] * round(self.delay / h)
        fast = [rest]  # the current loop computes for one of its samples
        sampler.motion[4 if len(sampler.motion) == 5 else 1] = self.origin
        wanted = wanted + self.origin
        y, u = np.empty(len(sampler_signals(sampler))), np.empty(1)
        actual, commands = np.empty(n), np.empty(n)
        load, follows, at_load = self.origin, settings.position > 0, self._designed[1].at_load
        for k in range(n):
            where, turning, _ = motion_of(sampler, at_load)
            load = min(max(load, where - 0.5 * backlash), where + 0.5 * backlash)
            shown = load if backlash > 0 else where
            actual[k] = (where if backlash == 0 else load) if follows else turning
            counts = np.floor(shown / self.resolution + 0.5) * self.resolution
            made = cascade.step(float(counts), float(wanted[k]), float(speed[k]), float(acceleration[k]))
            commands[k] = made
            for _ in range(pieces):
                late.append(made)
                acting = late.pop(0)
                if current:
                    amps = motion_of(sampler, at_load)[2]
                    fast.append(cascade.current(acting, amps))
                    commands[k] = acting = fast.pop(0)
                u[0] = acting
                sampler.advance(u, y)
                if backlash > 0:
                    where = motion_of(sampler, at_load)[0]
                    load = min(max(load, where - 0.5 * backlash), where + 0.5 * backlash)
        reference = wanted if follows else speed
        error = float(np.sqrt(np.mean((reference - actual)[counted] ** 2)))
        overshoot = changes = float("nan")
        if name == "step":
            overshoot = max(float(np.max(actual - reference[0]) / (reference[-1] - reference[0])) - 1.0, 0.0)
        if name == "hold":
            signs = np.sign(commands[counted] - rest)
            signs = signs[signs != 0]
            changes = float(np.count_nonzero(np.diff(signs)) / (np.count_nonzero(counted) * self.dt))
        return BenchRun(self.dt * np.arange(n, dtype=float), reference, actual, commands, error, overshoot, changes)


def unit_of(model: Any) -> str:
    """The unit of what drives a plant: V, A, N*m or N."""
    if model.name == "linear-axis":
        return "N"
    return {"voltage": "V", "current": "A", "torque": "N*m"}.get(model.plant.feed.value, "V")


def sampler_signals(sampler: Any) -> Any:
    """The signals that a sampler reads."""
    return sampler.numbers[0].signals


def motion_of(sampler: Any, at_load: bool) -> tuple[float, float, float]:
    """Position, speed and current of a plant; the current of one mass without inductance is not a number."""
    motion = sampler.motion.tolist()
    if len(motion) == 5:  # a motor with a shaft
        return (motion[4], motion[2], motion[0]) if at_load else (motion[4] + motion[3], motion[1], motion[0])
    return motion[1], motion[0], motion[2] / sampler.numbers[1].per_ampere if len(motion) == 3 else float("nan")


def fitted_bench(
    model: Any,
    inverse: Compensation,
    plants: Plants,
    dt: float,
    limit: float | None,
    delay: float,
    current_dt: float,
    amplitude: float | None = None,
) -> ControlBench:
    """The bench for a plant, from its own sizes.

    The largest speed of the slow sine is that at which the linear part needs the voltage (force) that dead zone and
    break-away take, so that both matter alike; of a plant with neither, a tenth of what the limit gives. Under gravity
    it begins a quarter of its wave from rest, as a level arm, or at rest where the limit does not bear that.

    Raises:
        ModelError: for a limit that does not reach the break-away, or is missing; for a speed that is not positive.
    """
    inside, zone = inverse.inside, inverse.zone
    per_volt = inside.after * inside.before
    friction = float(np.max(inverse.friction.breakaway))
    jump = max(zone.b_r, -zone.b_l) + friction / per_volt
    damping = inside.braking + float(np.max(inverse.friction.viscous))
    tau = inside.mass / damping if damping > 0 else inf
    supply = float(inverse.outer.drive[4]) / abs(float(inverse.outer.drive[0]))
    if limit is not None and not (isfinite(limit) and limit > 0):
        raise ModelError(f"a limit of {limit!r}; give a positive number", arguments=("limit",))
    most = min(limit if limit is not None else supply, supply)
    if not jump > 0:
        if not isfinite(most):
            raise ModelError(
                f"{inverse.name} has neither dead zone nor friction nor a supply, so that the size of a move is not "
                "known; give the largest command",
                arguments=("limit",),
            )
        jump = 0.1 * most * abs(float(inverse.outer.drive[0]))
    tau = min(tau, MOST_SAMPLES * dt / TIMES)
    if amplitude is not None and not (isfinite(amplitude) and amplitude > 0):
        raise ModelError(f"an amplitude of {amplitude!r}; give a positive speed", arguments=("amplitude",))
    speed = jump * per_volt * tau / inside.mass if amplitude is None else amplitude
    samples = int(min(max(TIMES * tau / dt, LEAST_SAMPLES), MOST_SAMPLES))
    reference = speed * np.sin(2 * np.pi * np.arange(samples) / samples)
    hung = motion_of(getattr(start(model, dt=dt), "sampler", None), True)[0]
    level = hung + min((0.5 * np.pi / k for k, c, s in inverse.friction.waves.tolist() if c or s), default=0.0)
    needs = {at: float(np.max(np.abs(inverse.feedforward(reference, at)))) for at in (level, hung)}
    if not isfinite(most):
        most = 2 * needs[level]
    origin, need = next(((at, each) for at, each in needs.items() if each <= most), (hung, needs[hung]))
    if need > most:
        raise ModelError(
            f"a limit of {most:.4g} is below the {need:.4g} that a speed of {speed:.4g} takes; raise it, or give a "
            "smaller amplitude",
            arguments=("limit", "amplitude"),
        )
    return ControlBench(
        model, dt, delay, current_dt, most, speed, samples * dt, speed * dt / COUNTS, origin, plants=plants
    )


def rows_of(bench: ControlBench) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """The table of a bench as text: its header, and a row for every reference and controller.

    Errors are RMS; the last column is the most changes of the sign of the command per second, at hold.
    """
    plants = list(dict.fromkeys(plant for _, _, plant in bench.runs))
    rows = []
    for reference in REFERENCES:
        for name in bench.names:
            each = [bench.runs[name, reference, plant] for plant in plants]
            changes = max(run.changes for run in each)
            cells = (f"{run.error:.3g}" for run in each)
            rows.append((reference, name, *cells, "" if changes != changes else f"{changes:.2g}"))
    return ("reference", "controller", *plants, "changes of sign/s"), rows
