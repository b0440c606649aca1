"""`emsid.control`: from an identified plant to a cascade of loops, with the margins of its region and its bench."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf, isfinite, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.arguments import as_names_with_commas
from emsid.compensation import Compensation, compensate
from emsid.compensation.inverse import lower_ends
from emsid.controllers.bench import BARE, CASCADE, FIXED, ControlBench, fitted_bench, unit_of
from emsid.controllers.cascade import HALF, MOST_DELAY, WAVES, RunningCascade, Settings, knots
from emsid.controllers.gains import Row, firmware
from emsid.controllers.loops import INPUTS, Margins, Plants, Sampled, controller_of, frequencies
from emsid.controllers.region import (
    check_identified,
    electrics_of,
    inverse_of,
    models_of_region,
    plants_of,
)
from emsid.controllers.tuning import LEAST, LoopResponses, Tuned, current_loop, fastest
from emsid.errors import ModelError
from emsid.estimation.fit import Fit
from emsid.exports.assumptions import refuse_assumed
from emsid.exports.verb import check_stable
from emsid.models.linear_parts import python_control
from emsid.models.verbs import as_model

Array = NDArray[np.float64]

OVERSHOOT = 0.05
"""The overshoot of a step that is allowed, unless one is given."""
CURRENT_RATE = 10
"""Samples of the current loop in one of the speed loop, unless its sample time is given."""
REDUCED = 0.97
"""A bandwidth below this part of the one that was wanted is reduced; the search finds it within 0.7 %, on a grid of
frequencies with steps of 3 %."""
BEYOND = 0.5
"""A bandwidth above this part of the sampling frequency cannot be controlled."""


@dataclass(frozen=True, eq=False, repr=False)
class Controller:
    """A cascade of loops for a plant; `emsid.control` makes it.

    Attributes:
        name: of the model.
        settings: the gains, see `Settings`.
        unit: of what the speed loop commands: V, A, N*m or N.
        linear: whether the plant moves in m, not in rad.
        delay: of the loop in s, from the sample of the position to the action of the command.
        resolution: a count of the encoder in rad (m).
        bandwidth: of the nominal closed loop, −3 dB, in Hz.
        nominal_bandwidth: that of the fastest cascade, or the wanted one, whose margins hold at the estimate alone.
        wanted_bandwidth: what was asked for in Hz; None for the fastest.
        margins: the worst over the region.
        nominal_margins: at the estimate.
        overshoot: of a step, the largest over the region, as a part of it.
        current_margins: of the current loop; None without one.
        plants: the plants of the region.
        draws: points of the region of the estimates; 0 for a model without intervals.
        bench: the plant on the bench.
        firmware: for SimpleFOC, ODrive, VESC and WPILib rows of name, value and unit.
    """

    name: str
    settings: Settings
    unit: str
    linear: bool
    delay: float
    resolution: float
    bandwidth: float
    nominal_bandwidth: float
    wanted_bandwidth: float | None
    margins: Margins
    nominal_margins: Margins
    overshoot: float
    current_margins: Margins | None
    plants: Plants
    draws: int
    bench: ControlBench
    firmware: Mapping[str, list[Row]]

    def __repr__(self) -> str:
        what = "position" if self.settings.position > 0 else "speed"
        return f"Controller({self.name}: {what} loop, {self.bandwidth:.3g} Hz, {self.unit})"

    @property
    def reduced(self) -> bool:
        """Whether its bandwidth is below what was asked for, or below what the estimate alone would allow."""
        return self.bandwidth < REDUCED * (self.wanted_bandwidth or self.nominal_bandwidth)

    def start(self) -> RunningCascade:
        """The cascade, ready to run sample by sample."""
        return RunningCascade(self.settings)

    @cached_property
    def loops(self) -> LoopResponses:
        """The frequency responses of its loops, for all plants of the region."""
        w = frequencies(self.settings.dt)
        return LoopResponses.of(Sampled.of(self.plants, self.settings.dt, self.delay).response(w), w, self.settings)

    def to_control(self) -> Any:
        """The linear part of the cascade as a discrete python-control system, from the measured position and the
        reference position, speed and acceleration to what the speed loop commands.

        Raises:
            ModelError: if python-control is not installed.
        """
        a, b, c, d = controller_of(self.settings)
        names = {"inputs": list(INPUTS), "outputs": ["command"], "name": self.name}
        return python_control().ss(a, b, c[None], d[None], self.settings.dt, **names)

    def to_data(self) -> dict[str, Any]:
        """Gains, margins and the table of the bench in built-in types."""
        from dataclasses import asdict

        from emsid.findings import plain

        s = asdict(self.settings)
        data = {
            "model": self.name,
            "unit": self.unit,
            "motion": "m" if self.linear else "rad",
            "settings": s,
            "delay": self.delay,
            "resolution": self.resolution,
            "bandwidth": self.bandwidth,
            "nominal_bandwidth": self.nominal_bandwidth,
            "wanted_bandwidth": self.wanted_bandwidth,
            "reduced": self.reduced,
            "margins": asdict(self.margins),
            "nominal_margins": asdict(self.nominal_margins),
            "current_margins": None if self.current_margins is None else asdict(self.current_margins),
            "overshoot": self.overshoot,
            "draws": self.draws,
            "firmware": {
                name: [{"name": row, "value": value, "unit": unit} for row, value, unit in rows]
                for name, rows in self.firmware.items()
            },
            "bench": self.bench.to_data(),
        }
        found: dict[str, Any] = plain(data)
        return found


def control(
    model: Any,
    *,
    dt: float | None = None,
    bandwidth: float | None = None,
    overshoot: float = OVERSHOOT,
    encoder: float | None = None,
    delay: float | None = None,
    loop: str = "position",
    current: bool | None = None,
    current_dt: float | None = None,
    limit: float | None = None,
    backlash: float | None = None,
    pole_pairs: int | None = None,
    current_max: float | None = None,
    assume: str | Sequence[str] = (),
    seed: int = 1,
    modes: Any = None,
) -> Controller:
    """A cascade of loops for an identified plant of one mass.

    The gains are those of the fastest cascade, or of the wanted bandwidth, whose gain margin of 2, phase margin of 45°,
    sensitivity of 2 and overshoot hold for every plant of the region: the 95 % region of the estimates, each with
    friction 30 % lower and higher. Where they do not hold, the bandwidth is reduced.

    Args:
        model: a fit or a model: rigid-motor, motor without shaft, joint or linear-axis.
        dt: sample time of speed and position loop in s; by default that of the record.
        bandwidth: −3 dB of the closed loop in Hz; by default the fastest.
        overshoot: the largest overshoot of a step, as a part of it.
        encoder: counts per revolution (per m); by default one with ten counts in a sample at the bench's speed.
        delay: from the sample of the position to the action of the command in s; by default one sample.
        loop: ``position``, or ``speed`` for no position loop.
        current: whether there is a current loop; by default where resistance and inductance are known.
        current_dt: its sample time in s; by default a tenth of ``dt``.
        limit: the largest command; by default that of the drive, or twice what the bench needs.
        backlash: on the bench, in rad (m); by default that of the model, or three counts.
        pole_pairs: of the motor, for the gains of a VESC.
        current_max: the largest current of the VESC in A.
        assume: parameters whose values nobody gave or measured and that may be used, by name or symbol.
        seed: of the points on the region.
        modes: of a plant of one mass, a measured mode for the notch filter: what `emsid.modes` gives of a fit to a
            frequency response at the motor, or that fit. Its lowest resonance above an antiresonance is taken, and
            margins hold over its intervals.

    Returns:
        The cascade with its margins; ``bench.table`` compares it with usual rules, and
        `emsid.controllers.files.write` writes it in C.

    Raises:
        ModelError: for a model without inertia and friction, one that is not identified, or runs away, or whose values
            are assumed; for targets that the sampling cannot reach.

    >>> import emsid
    >>> motor = emsid.plants.rigid_motor().with_values({"rotor_friction.coulomb": 0.02})
    >>> found = emsid.control(motor, dt=1e-3, encoder=2000)
    >>> found.margins.gain >= 2, found.margins.phase >= 45, found.overshoot <= 0.05
    (True, True, True)
    """
    if loop not in ("position", "speed"):
        raise ModelError(
            f"loop {loop!r}; give position or speed, or current of a brushless motor (in Python, "
            "emsid.controllers.current_control)",
            arguments=("loop",),
        )
    subject: Any = as_model(model)
    step = dt if dt is not None else subject.dt
    segments = getattr(model, "segments", None) or ()
    if step is None and segments:
        step = segments[0].dt
    for name, value in (
        ("dt", step),
        ("bandwidth", bandwidth),
        ("encoder", encoder),
        ("current_dt", current_dt),
        ("pole_pairs", pole_pairs),
        ("current_max", current_max),
    ):
        if value is not None and not (isfinite(value) and value > 0):
            raise ModelError(f"{name} {value!r}; give a positive number", arguments=(name,))
    if step is None:
        raise ModelError(f"{subject.name} has no sample time of its own; give the controller's", arguments=("dt",))
    if not 0 < overshoot < 1:
        raise ModelError(f"an overshoot of {overshoot!r}; give a part between 0 and 1", arguments=("overshoot",))
    if delay is not None and not (isfinite(delay) and 0 <= delay <= 100 * step):
        raise ModelError(f"a delay of {delay!r} s; give 0 to 100 sample times", arguments=("delay",))
    if bandwidth is not None and bandwidth > BEYOND / step:
        raise ModelError(
            f"a bandwidth of {bandwidth:g} Hz is above half the sampling frequency, {BEYOND / step:g} Hz; ask for "
            "less, or sample faster",
            arguments=("bandwidth", "dt"),
        )
    estimated = inverse_of(model, step)
    check_stable(subject, step)
    check_identified(model)
    refuse_assumed(model if isinstance(model, Fit) else None, "control", as_names_with_commas(assume))
    region = models_of_region(model, seed)
    electrics = electrics_of(region)
    if current and electrics is None:
        raise ModelError(
            f"a current loop needs resistance and inductance, which are not known of {subject.name}; identify it with "
            "the inductance estimated, or leave the current loop out",
            arguments=("current",),
        )
    cascaded = electrics is not None if current is None else current
    fast = current_dt or step / CURRENT_RATE
    late = step if delay is None else delay
    drive_delay = float(subject.plant.drive.delay)
    inverses = [estimated, *(inverse_of(each, step) for each in region[1:])]
    measured = None if modes is None else measured_mode(modes)
    if measured is not None and "shaft_stiffness" in subject.parameter_values():
        raise ModelError(f"{subject.name} has a shaft, whose mode is taken; leave modes out", arguments=("modes",))

    def plants_for(current: bool) -> Plants:
        found = plants_of(region, inverses, current)
        return found if measured is None else found.with_mode(*measured)

    plants = plants_for(cascaded)
    inner: Margins | None = None
    kp = ki = 0.0
    if cascaded and electrics is not None:
        kp, ki, inner = current_loop(electrics.resistance, electrics.inductance, fast)
        plants = replace(plants, lag=float(electrics.inductance[0]) / kp)
    whole_delay = late + drive_delay + (1.5 * fast if cascaded else 0.0)

    if whole_delay + plants.lag > MOST_DELAY * step:
        raise ModelError(
            f"a delay of {whole_delay + plants.lag:g} s in all; the most is {MOST_DELAY} sample times, "
            f"{MOST_DELAY * step:g} s",
            arguments=("delay", "dt"),
        )
    cautious = inverse_of(lower_ends(model), step)
    base, bench = without_gains(subject, cautious, plants, encoder, limit, late, fast if cascaded else 0.0)
    resolution = bench.resolution
    base = replace(base, current_proportional=kp, current_integral=ki, band=HALF * resolution)
    follows = loop == "position"
    wanted = inf if bandwidth is None else 2 * pi * bandwidth
    found = fastest(plants, base, whole_delay, overshoot, position=follows, wanted=wanted)
    if found is None:
        raise ModelError(
            f"no {loop} loop of {subject.name} keeps a gain margin of {LEAST.gain:g}, a phase margin of "
            f"{LEAST.phase:g}° and an overshoot of {100 * overshoot:g} % at a sample time of {step:g} s and a delay of "
            f"{late:g} s; sample faster, or allow more overshoot",
            arguments=("dt", "delay", "overshoot"),
        )
    alone = fastest(plants.nominal, base, whole_delay, overshoot, position=follows, wanted=wanted, shapes=[found.shape])
    settings = smoothed(found.settings)
    widest = _backlash(subject, backlash, resolution)
    bench = replace(bench, settings=settings, backlash=widest, plants=plants, whole_delay=whole_delay)
    unit, values = "A" if cascaded else unit_of(subject), subject.parameter_values()
    constant = float(values.get("motor_constant", 0.0)) if unit in ("V", "A") else 0.0

    def usual(these: Plants, late: float) -> Settings | None:
        """The cascade with a PI controller, which firmware has."""
        tuned = fastest(these, base, late, overshoot, position=follows, wanted=wanted, observer=False)
        return None if tuned is None else tuned.settings

    plain = usual(plants, whole_delay)
    commands_current = plain if unit == "A" else None
    if unit == "V" and constant > 0:
        commands_current = usual(plants_for(True), late)
    tables = firmware(
        plain, unit, commands_current, constant, float(values.get("inductance", 0.0)), pole_pairs, current_max
    )
    return Controller(
        subject.name, settings, unit, subject.name == "linear-axis", whole_delay, resolution,
        found.bandwidth / (2 * pi), (alone or found).bandwidth / (2 * pi), bandwidth, found.margins,
        _nominal(found, plants, whole_delay), found.overshoot, inner, plants,
        len(region) - 1, bench, tables,
    )  # fmt: skip


def measured_mode(modes: Any) -> tuple[tuple[Array, Array], Array]:
    """Resonance (frequencies in rad/s, damping ratios) and antiresonance of a measured mode, and at their intervals.

    Args:
        modes: a `ModeTable`, or what `emsid.modes` makes one of.

    Raises:
        ModelError: for modes without a resonance above an antiresonance.
    """
    from emsid.validation import analysis
    from emsid.validation.responses import ModeTable

    table = modes if isinstance(modes, ModeTable) else analysis.modes(modes)
    above = next((k for k in range(1, len(table)) if table.kind[k - 1 : k + 1] == ("antiresonance", "resonance")), None)
    if above is None:
        raise ModelError(
            f"{table.of} has no resonance above an antiresonance; the notch filter needs the response at the motor, "
            "from its command to its own speed or position",
            arguments=("modes",),
        )
    columns = table.columns()
    ends = {name: [columns[name], columns[f"{name}_low"], columns[f"{name}_high"]] for name in ("frequency", "damping")}
    (f, *f_ends), (ratio, *ratio_ends) = ends["frequency"], ends["damping"]
    rows = [(f[above], ratio[above], f[above - 1])]
    if all(np.isfinite(each[above]) for each in (*f_ends, *ratio_ends)):
        rows += [(one[above], other[above], one[above - 1]) for one in f_ends for other in ratio_ends]
    found = np.array(rows)
    return (2 * pi * found[:, 0], np.maximum(found[:, 1], 1e-4)), 2 * pi * found[:, 2]


def smoothed(settings: Settings) -> Settings:
    """Gains with the widths of smoothing of their encoder.

    Up to the voltage that one count adds, the inverse of the dead zone is a straight line. The direction of friction is
    one up to the speed of a count in the time constant of the speed loop.
    """
    volts = settings.per_count * (settings.current_proportional if settings.current_dt > 0 else 1.0)
    width = settings.proportional * settings.model[2] / settings.dt * settings.band / HALF
    return replace(settings, zone_width=volts, speed_width=width)


def _nominal(found: Tuned, plants: Plants, delay: float) -> Margins:
    w = frequencies(found.settings.dt)
    response = Sampled.of(plants.nominal, found.settings.dt, delay).response(w)
    return LoopResponses.of(response, w, found.settings).margins


def _backlash(model: Any, given: float | None, resolution: float) -> float:
    """The backlash of the bench in rad (m)."""
    if given is not None:
        if not (isfinite(given) and given >= 0):
            raise ModelError(f"a backlash of {given!r}; give zero or a positive number", arguments=("backlash",))
        return given
    values = model.parameter_values()
    return max(values.get("backlash", 0.0), values.get("sensor.backlash", 0.0)) or 3 * resolution


def without_gains(
    model: Any,
    inverse: Compensation,
    plants: Plants,
    encoder: float | None,
    limit: float | None,
    delay: float,
    current_dt: float,
    amplitude: float | None = None,
) -> tuple[Settings, ControlBench]:
    """Feed-forward, friction and dead zone of a cascade, and the bench with its encoder, without gains.

    Args:
        model: the plant.
        inverse: its friction and dead zone as they are compensated.
        plants: those of the region.
        encoder, limit, delay: as for `control`.
        current_dt: sample time of the current loop in s; 0 for none.
        amplitude: the largest speed of the bench in rad/s (m/s); by default one of its own.
    """
    zone, dt = inverse.zone, inverse.dt
    gain, offset, _, _, _, loss, *_ = inverse.outer.drive.tolist()
    force, damping, mass = float(plants.force[0]), float(plants.damping[0]), float(plants.mass[0])
    bench = fitted_bench(model, inverse, plants, dt, limit, delay, current_dt, amplitude)
    if encoder is not None:
        bench = replace(bench, resolution=(1.0 if model.name == "linear-axis" else 2 * pi) / encoder)
    rate = damping / mass
    hold = dt if rate * dt < 1e-9 else float(-np.expm1(-rate * dt) / rate)
    exact, speeds, moves = replace(inverse, speed_width=0.0), knots(2 * bench.speed), 1e-12 * bench.speed
    table = []
    for way in (1.0, -1.0):
        level = np.abs(exact.friction_force(way * (speeds + moves))) / force
        level[0] = np.abs(float(exact.friction_force(0.0, way * moves))) / force  # break-away
        table.append(tuple(level.tolist()))
    nothing = [[0.0] * 3] * WAVES
    settings = Settings(
        dt=dt, position=0.0, proportional=0.0, integral=0.0,
        per_speed=damping / force, per_acceleration=mass * dt / hold / force, load=float(inverse.friction.load) / force,
        waves=tuple((k, c / force, s / force) for k, c, s in [*inverse.friction.waves.tolist(), *nothing][:WAVES]),
        friction=(table[0], table[1]), friction_speed=float(speeds[-1]),
        zone_low=zone.b_l, zone_high=zone.b_r, slope_low=zone.m_l, slope_high=zone.m_r,
        gain=gain * (1.0 - loss), offset=offset, limit=bench.limit, current_dt=current_dt,
    )  # fmt: skip
    if current_dt > 0:
        resistance = float(model.parameter_values()["resistance"])
        settings = replace(settings, current_limit=abs(gain) * bench.limit / resistance)
    return settings, bench


def compensated(
    model: Any,
    *,
    dt: float,
    encoder: float | None = None,
    zone_width: float | None = None,
    speed_width: float | None = None,
    limit: float | None = None,
    delay: int = 1,
    amplitude: float | None = None,
) -> tuple[Compensation, ControlBench]:
    """The inverse of a plant, and a cascade on the bench with it and without.

    The cascade is the fastest that keeps its margins at the estimate and with friction 30 % off; on the bench friction
    and dead zone are each 30 % off.

    Args:
        model: a plant of one mass, or a fit of one.
        dt: sample time in s.
        encoder: counts per revolution (per m); by default one with ten counts in a sample at the bench's speed.
        zone_width, speed_width: as for `emsid.compensate`.
        limit: the largest command.
        delay: in samples.
        amplitude: the largest speed of the bench in rad/s (m/s).

    Raises:
        ModelError: as `emsid.compensate`, for a model that runs away, and where no cascade keeps its margins.
    """
    subject: Any = as_model(model)
    estimated = inverse_of(subject, dt)
    check_stable(subject, dt)
    plants = plants_of([subject], [estimated], False)
    if encoder is None:
        whole = without_gains(subject, estimated, plants, None, limit, delay * dt, 0.0, amplitude)[1]
        encoder = (1.0 if subject.name == "linear-axis" else 2 * pi) / whole.resolution
    inverse = compensate(model, dt=dt, encoder=encoder, zone_width=zone_width, speed_width=speed_width)
    assert isinstance(inverse, Compensation)
    base, bench = without_gains(subject, inverse, plants, encoder, limit, delay * dt, 0.0, amplitude)
    whole_delay = delay * dt + float(subject.plant.drive.delay)
    base = replace(base, band=HALF * bench.resolution)
    found = fastest(plants, base, whole_delay, OVERSHOOT)
    if found is None:
        raise ModelError(
            f"no position loop of {subject.name} keeps its margins at a sample time of {dt:g} s and a delay of {delay} "
            "samples; sample faster",
            arguments=("dt", "delay"),
        )
    settings = replace(found.settings, zone_width=inverse.zone_width, speed_width=inverse.speed_width)
    wrong = ("friction", "dead zone")
    bench = replace(
        bench, settings=settings, plants=plants, whole_delay=whole_delay, names=(CASCADE, FIXED, BARE), wrong=wrong
    )
    return inverse, bench
