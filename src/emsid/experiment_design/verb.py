"""`emsid.design`: the next experiment for a fitted model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError, ModelError, listed
from emsid.estimation.estimates import HALF_WIDTH
from emsid.estimation.fit import Fit
from emsid.excitation import SIGNALS
from emsid.experiment_design.information import Inseparable, Sensitivities, errors_of, inseparable
from emsid.experiment_design.known import Known, known_before
from emsid.experiment_design.limits import Limits
from emsid.experiment_design.search import CRITERIA, searched
from emsid.findings import Finding
from emsid.models.verbs import as_model
from emsid.record import Record
from emsid.units import plain_unit

Array = NDArray[np.float64]

STANDARD = ("multisine", "prbs", "ramp", "staircase")
"""The signals that a design is compared with, of `emsid.excitation.SIGNALS`."""
FEWEST = 200
"""The fewest samples of a design: 25 in each of its sections."""
MOST_SAMPLES = 1_000_000
"""The most samples: an hour at 3.6 ms."""
GAINED = 1.05
"""A design is worth another signal if its intervals are narrower by this factor; less is below the precision of M."""
MOVES = 1e-9
"""Less information than this about every parameter: nothing moves."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """A signal with the intervals that it leads to.

    Attributes:
        name: of the signal.
        command: (N, nc) the signal of every input.
        half_widths: of the 95 % interval of every parameter, in its unit; infinite where not determined.
        size: root of the criterion: the typical relative standard error of the wanted parameters.
    """

    name: str
    command: Array
    half_widths: dict[str, float]
    size: float


@dataclass(frozen=True, eq=False)
class Design:
    """The next experiment.

    Attributes:
        record: the command as a record without outputs.
        wanted: the parameters whose intervals are made small.
        values, units: of all parameters.
        best: what the command leads to.
        standard: the same of the standard signals within the same limits, by name.
        present: half widths of the present intervals.
        gain: how many times narrower the intervals of the wanted parameters are than with the best standard signal.
        findings: what is not separated, and whether anything is gained.
    """

    record: Record
    wanted: tuple[str, ...]
    values: dict[str, float]
    units: dict[str, str]
    best: Prediction
    standard: dict[str, Prediction]
    present: dict[str, float]
    gain: float
    findings: tuple[Finding, ...]

    def to_data(self) -> dict[str, Any]:
        """Everything but the signals, in built-in types; None for an interval that is not determined."""

        def finite(widths: Mapping[str, float]) -> dict[str, float | None]:
            return {name: value if isfinite(value) else None for name, value in widths.items()}

        return {
            "wanted": list(self.wanted),
            "values": self.values,
            "units": self.units,
            "signal": self.best.name,
            "gain": self.gain,
            "half_widths": {"present": finite(self.present), "design": finite(self.best.half_widths)}
            | {name: finite(each.half_widths) for name, each in self.standard.items()},
            "findings": [finding.to_data() for finding in self.findings],
        }


def design(
    fit: Any,
    *,
    limit: float,
    duration: float,
    dt: float | None = None,
    limit_slew: float = inf,
    limit_speed: float = inf,
    limit_travel: float = inf,
    limit_current: float = inf,
    wanted: Sequence[str] = (),
    criterion: str = "a",
    noise: float | Sequence[float] | None = None,
    datasheet: Mapping[str, Any] | None = None,
    seed: int = 1,
) -> Design:
    """A test signal that makes the intervals of some parameters small.

    Parameters that the records of a fit do not determine, and that a test does (`Plant.tests`), are wanted before all
    others. Their values come from a datasheet, whose tolerances say how far off they may be; dry friction and damping
    that nobody gave may be from zero to a tenth of what the largest command overcomes. The limits hold for all of these
    values.

    Args:
        fit: a fitted model, for its parameters and its noise; a plant, a cascade or another model with parameters. With
            a datasheet a plant without estimates.
        limit: the largest command either way, in its unit.
        duration: in s.
        dt: sample time in s, for a model that has none of its own.
        limit_slew: the fastest change of the command per second.
        limit_speed: the largest speed in rad/s (m/s).
        limit_travel: the largest distance between two positions in rad (m).
        limit_current: the largest current in A; of a brushless motor the amplitude of both axes.
        wanted: the parameters to determine, by name or its end: ``friction.coulomb``; by default those that are open,
            or else all estimated ones.
        criterion: ``a`` for the mean square of the relative standard errors, ``d`` for the volume of their region.
        noise: standard deviation of the error of the output, or of every output; by default that of the fit.
        datasheet: values of parameters that are open, as `emsid.fit` takes them; without a tolerance 30 %.
        seed: of the search and of the standard signals.

    Returns:
        The signal with its predicted intervals, beside those of standard signals within the same limits.

    Raises:
        ModelError: for a model without estimates or noise, an unknown parameter or criterion, or open parameters
            without values.
        DataError: for limits that no signal meets, or a duration that is too short.
    """
    if criterion not in CRITERIA:
        raise ModelError(f"no criterion {criterion!r}; there are {', '.join(CRITERIA)}", arguments=("criterion",))
    if not (isinstance(fit, Fit) and len(fit.names)) and not datasheet:
        name = as_model(fit).name
        raise ModelError(f"{name} has no estimates; give a fit, such as `emsid.identify` finds, or a datasheet")
    limits = Limits(limit, limit_slew, limit_speed, limit_travel, limit_current)
    step, samples = _sampling(as_model(fit), dt, duration)
    known = known_before(fit, datasheet, limits, step)
    sensitivities = Sensitivities.of(known.model, known.names, known.errors, step, _noise(fit, known.model, noise))
    names = tuple(dict.fromkeys(_named(known, each) for each in wanted)) or known.open or known.names
    indices = np.array([known.names.index(name) for name in names])
    rng = np.random.default_rng(seed)
    standard = _standard(sensitivities, limits, known.possible, samples, indices, criterion, seed)
    _check_moves(sensitivities, limits, standard)
    found = searched(sensitivities, limits, samples, _least(known.model, limit), indices, CRITERIA[criterion], rng)
    best = None if found is None else limits.scaled(known.possible, found, step)
    if best is not None:
        predicted = _predicted("design", sensitivities, best, indices, criterion)
    rival = min(standard.values(), key=lambda each: each.size, default=None)
    if best is None or (rival is not None and rival.size <= predicted.size * GAINED):
        if rival is None:
            raise _nothing(known.model.name, limits)
        predicted = rival
    gain = 1.0 if predicted is rival else (inf if rival is None else rival.size / predicted.size)
    apart = inseparable(sensitivities, [predicted.command, *(each.command for each in standard.values())])
    units = {name: plain_unit(known.unit(name)) for name in known.names}
    return Design(
        _record(fit, known.model, predicted.command, step),
        names,
        dict(zip(known.names, known.values, strict=True)),
        units,
        predicted,
        standard,
        known.present,
        gain,
        _findings(known, predicted, gain, apart),
    )


def _sampling(model: Any, dt: float | None, duration: float) -> tuple[float, int]:
    step = model.dt if model.dt is not None else dt
    if step is None:
        raise ModelError(f"{model.name} has no sample time of its own; give one", arguments=("dt",))
    if not (isfinite(step) and step > 0):
        raise DataError(f"a sample time of {step!r} s; give a positive number", arguments=("dt",))
    if not (isfinite(duration) and FEWEST <= duration / step <= MOST_SAMPLES):
        raise DataError(
            f"a duration of {duration:g} s at a sample time of {step:g} s; give {FEWEST} to {MOST_SAMPLES:,} samples, "
            f"{FEWEST * step:g} to {MOST_SAMPLES * step:g} s",
            arguments=("duration",),
        )
    return step, round(duration / step)


def _noise(fit: Any, model: Any, noise: float | Sequence[float] | None) -> Array:
    outputs = len(getattr(model, "signals", (0,)))
    known = getattr(fit, "output_noise", None) if isinstance(fit, Fit) else None
    if noise is not None:
        found = np.atleast_1d(np.asarray(noise, dtype=float))
    elif known is not None and len(known) == outputs:
        found = np.asarray(known, dtype=float)
    elif isinstance(fit, Fit) and outputs == 1:
        found = np.array([sqrt(fit.noise_variance)])
    else:
        raise ModelError(
            f"the noise of {model.name} is not known; give its standard deviation in every output", arguments=("noise",)
        )
    if len(found) != outputs:
        named = listed([name for name, _ in getattr(model, "output_channels", ())]) if outputs > 1 else "its output"
        raise ModelError(
            f"{len(found)} standard deviations for {named} of {model.name}; give one of each", arguments=("noise",)
        )
    if not (np.isfinite(found).all() and (found > 0).all()):
        raise ModelError(
            f"noise with a standard deviation of {found.min():g}; give a positive one, in the unit of the output",
            arguments=("noise",),
        )
    return found


def _named(known: Known, asked: str) -> str:
    """The full name of a parameter that may be determined, by its name, its end or its symbol."""
    if asked in known.names:
        return asked
    ends = [name for name in known.names if name.endswith((f"_{asked}", f".{asked}"))]
    symbols = [row.name for row in known.rows.values() if row.symbol == asked and row.name in known.names]
    for some in (ends, symbols):
        if len(some) == 1:
            return some[0]
    if asked in known.rows:
        raise ModelError(f"{asked} is {known.rows[asked].how}, not estimated; name estimated parameters")
    which = f"several parameters {asked!r}" if ends else f"no estimated parameter {asked!r}"
    raise ModelError(f"{known.model.name} has {which}; it has {listed(list(ends or known.names))}", arguments=("for",))


def _least(model: Any, limit: float) -> float:
    """A size of the command at which a plant hardly moves: half its dead zone and break-away, or 2 % of the limit."""
    plant = getattr(model, "plant", None)
    zone = None if plant is None else plant.dead_zone_characteristic()
    return max(0.02 * limit, 0.0 if zone is None else 0.5 * zone.edge)


def _predicted(name: str, of: Sensitivities, u: Array, wanted: Array, criterion: str) -> Prediction:
    information = of.information(u)
    errors = errors_of(of.covariance_of_fit(u))
    unknown = errors > 10.0  # ten times the value: not determined
    half = np.where(unknown, inf, HALF_WIDTH * errors * of.scale)
    size = float(np.sqrt(CRITERIA[criterion](information, wanted)))
    return Prediction(name, u, dict(zip(of.names, half.tolist(), strict=True)), size)


def _standard(
    of: Sensitivities,
    limits: Limits,
    possible: Sequence[Any],
    samples: int,
    wanted: Array,
    criterion: str,
    seed: int,
) -> dict[str, Prediction]:
    """The standard signals as large as the limits allow; every input has one of its own."""
    found = {}
    for name in STANDARD:
        seeds = range(seed, seed + of.inputs)
        signals = [SIGNALS[name](samples, of.dt, limits.command, np.random.default_rng(each)) for each in seeds]
        fitting = limits.scaled(possible, np.column_stack(signals), of.dt)
        if fitting is not None:
            found[name] = _predicted(name, of, fitting, wanted, criterion)
    return found


def _check_moves(of: Sensitivities, limits: Limits, standard: Mapping[str, Prediction]) -> None:
    """Refuse limits within which nothing moves.

    Raises:
        DataError: for such limits.
    """
    if not standard or all(not of.information(prediction.command).max() > MOVES for prediction in standard.values()):
        raise _nothing(of.model.name, limits)


def _nothing(name: str, limits: Limits) -> DataError:
    given = {"command": limits.command, "slew rate": limits.slew, "speed": limits.speed, "travel": limits.travel}
    given["current"] = limits.current
    named = ", ".join(f"{what} {value:g}" for what, value in given.items() if isfinite(value))
    return DataError(
        f"no signal within these limits ({named}) moves {name}; raise the limit that holds it",
        arguments=(
            "limit",
            *(("limit_speed",) if isfinite(limits.speed) else ()),
            *(("limit_current",) if isfinite(limits.current) else ()),
        ),
    )


def _record(fit: Any, model: Any, command: Array, dt: float) -> Record:
    channels = getattr(fit, "channels", None) if isinstance(fit, Fit) else None
    given = channels.inputs if channels is not None and channels.inputs else (("voltage", "V"),)
    names = getattr(getattr(model, "plant", None), "test_names", ("",))
    if len(names) > 1:
        given = tuple((name, given[0][1] if given[0][0] in names else "V") for name in names)
    return Record(
        command,
        dt=dt,
        input_names=tuple(name for name, _ in given[: len(names)]),
        input_units=tuple(unit for _, unit in given[: len(names)]),
        name="designed experiment",
    )


def _findings(known: Known, best: Prediction, gain: float, apart: Inseparable | None) -> tuple[Finding, ...]:
    found, name = [], known.model.name
    if known.open:
        shares = {
            each: best.half_widths[each] / abs(known.values[known.names.index(each)])
            for each in known.open
            if isfinite(best.half_widths[each])
        }
        left = [each for each in known.open if each not in shares]
        data = {"names": list(shares), "shares": list(shares.values()), "left": left}
        found.append(Finding("design-determines", name, data))
    if known.ranges:
        rows = [[each, low, high, known.unit(each)] for each, (low, high) in known.ranges.items()]
        found.append(Finding("design-assumes", name, {"ranges": rows}))
    if gain == 1.0:
        found.append(Finding("design-gains-nothing", name, {"signal": best.name}))
    if apart is not None:
        data = {"names": list(apart.names), "directions": apart.directions, "remedies": list(apart.remedies)}
        found.append(Finding("not-separable", name, data))
    return tuple(found)
