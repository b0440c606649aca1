r"""The parameters of a grey box from records: what is asked, where the search starts, what the records can tell.

The search is `gauss_newton` on the error of the free run (`problem`). Not every parameter can be
told from every record: from voltage and speed of a rigid motor, R_a, K_m and J can be anything that keeps K_m/(R_a·J)
and K_m²/(R_a·J). The information matrix shows that (`identifiability`) at the start and again at the
end with the noise found; the parameters to hold are taken in the order in which a datasheet is likeliest to have them
right, and the fit says what it held, at what, and which combinations do not depend on it (`result`).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from math import inf, isfinite

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError, EmsidError, ModelError, listed
from emsid.estimation.fit import Ending, Fit
from emsid.estimation.linear.information import inverse_triangle
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.nonlinear.gauss_newton import Infeasible, Minimum, gauss_newton
from emsid.estimation.threads import one_blas_thread
from emsid.estimation.uncertainty.coloured_residuals import coloured_covariance
from emsid.estimation.uncertainty.identifiability import Identifiability, identifiability
from emsid.findings import Finding
from emsid.models.plants.datasheet import Given
from emsid.models.plants.drive import Drive
from emsid.models.plants.grey_box import GreyBox, check_channels, signals_of
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.one_mass import Motion
from emsid.models.plants.parameters import Handle, Signal, find_handle, refuse_overlap, without_overlap
from emsid.models.plants.plant import DrivenPlant, Plant
from emsid.models.plants.search.problem import FreeRunError, Weighting, all_alike
from emsid.models.plants.search.result import GreyBoxFit, at_bounds, combinations, hardly_told, in_words, table
from emsid.models.plants.search.starts import motions
from emsid.models.plants.wishes import as_bounds, as_signals, by_full_name, full_names
from emsid.plant import Motor
from emsid.plant.motor import read_number
from emsid.record import Record, check_same_channels
from emsid.units import with_unit
from emsid.wording import sentence

Array = NDArray[np.float64]


@one_blas_thread()
def simulation_error(
    plant: Plant | Motor,
    records: Record | Iterable[Record],
    *,
    free: str | Sequence[str] | None = None,
    fixed: Mapping[str, float | str] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    datasheet: Mapping[str, Given] | None = None,
    signals: str | Signal | Sequence[str | Signal] | None = None,
    weighting: Weighting = all_alike,
    look_around: bool = True,
    max_iterations: int = 60,
    threads: int | None = None,
    control: Control = FREE,
) -> GreyBoxFit:
    """The physical parameters that minimise the error of the free run over one or several records.

    Args:
        plant: what to fit, with its parameters as the start; a bare `Motor` gets a drive and a sensor without effect.
        records: a record, or several experiments, all with one set of parameters.
        free: the parameters to estimate, by name or symbol; by default what plants of this kind usually have unknown.
        fixed: values that are known, by name or symbol, in SI units or as texts with a unit; they are not estimated.
        bounds: (lower, upper) by name, in addition to what is physical.
        datasheet: what is known beforehand, see `Given`. A value is the start, and a tolerance bounds it.
        signals: what the outputs of the records are, `Signal` or its name, by default judged by their units.
        weighting: how errors count by their age: `all_alike`, `Recent`, or any other linear filter (error, dt) → error.
        look_around: whether to begin at the datasheet, or where a regression on the records says if that simulates
            better; otherwise the search begins with the plant as it is given.
        max_iterations: of the search, all its rounds together; what is held only in the end adds a few.
        threads: how many, by default as many as there are cores.
        control: when to stop, and whom to tell of every step.

    Raises:
        ModelError: for names that the plant does not have, bounds that exclude a start, a datasheet that contradicts
            itself.
        DataError: for records without motion, with other channels, in other units, or with an output of the wrong sign.
    """
    subject: Plant = DrivenMotor(plant) if isinstance(plant, Motor) else plant
    segments = _segments(records)
    subject = subject.fed(segments[0])
    shown = as_signals(signals) if signals is not None else signals_of(subject, segments[0])
    for segment in segments:
        check_channels(subject, shown, segment)
    _check_motion(segments)
    free, bounds = full_names(subject, free), as_bounds(subject, bounds)
    fixed = _values(subject, by_full_name(subject, "fixed", fixed))
    sheet = by_full_name(subject, "datasheet", datasheet)
    asked = _asked(subject, free, fixed, sheet)
    sheet |= {name: sheet[both] for name in asked if (both := _both_ways(name)) != name and both in sheet}
    known = {name: given.value for name, given in sheet.items() if given.value is not None}
    subject = subject.put((known if look_around else {}) | fixed)
    hidden = subject.unresolved([n for n in asked if n not in (*sheet, *bounds)], segments[0].dt)
    limits = _limits(subject, asked, {**hidden, **bounds}, sheet)
    straight = subject
    subject = straight.ready(asked, segments, limits)
    subject = subject.put({name: max(subject.value(name), low) for name, (low, _) in hidden.items()})
    _check_start(subject, asked, limits)

    preference = _preference(subject, asked, sheet)

    def problem_for(current: Plant, names: Sequence[str], states: Sequence[Array] | None = None) -> FreeRunError:
        guesses = [current.first_state(shown, s) for s in segments] if states is None else states
        unknown = [current.free_states(shown, s) for s in segments]
        return FreeRunError(
            current, shown, segments, names, guesses, unknown, weighting, threads or os.cpu_count() or 1
        )

    def search(problem: FreeRunError, iterations: int) -> Minimum:
        return _search(problem, limits, iterations, control)

    start = subject
    if look_around:
        bent = [subject] if straight.driven is None else straight.driven.bent(subject, asked, limits)
        starts = [_best_start(each, asked, limits, problem_for) for each in bent]
        start = min(starts, key=lambda each: _cost(problem_for(each, asked))) if len(starts) > 1 else starts[0]
    problem = problem_for(start, asked)
    names = _hold(_told(problem, asked, None), asked, preference)
    if len(names) < len(asked):
        problem = problem_for(_put_back(start, asked, names, known), names)
    coarse = [name for name in names if name not in start.fine]
    minimum: Minimum | None = None
    if 0 < len(coarse) < len(names):  # what moves the output most first
        rough = problem_for(problem.plant, coarse)
        beginning = search(rough, max_iterations)
        rough = rough.begun_at(beginning.estimate)
        if beginning.ending is Ending.INTERRUPTED:
            problem, names, minimum = rough, coarse, beginning
        else:
            problem = problem_for(_scan(rough, names, limits, problem_for), names, rough.states(rough.start))
    steps, bar, stayed = 0, inf, problem
    while minimum is None:
        share = min(LOOK, max(max_iterations - steps, min(LOOK, max_iterations)))
        ended = search(problem, share)
        steps += ended.iterations
        interrupted = ended.ending is Ending.INTERRUPTED
        under_way = ended.ending is Ending.OUT_OF_BUDGET and ended.iterations == share and steps < max_iterations
        if under_way and ended.costs[len(ended.costs) // 2] > (1 + FLAT) * ended.cost:
            problem = problem.begun_at(ended.estimate)
            continue
        if ended.cost > bar:  # the start of what is held matters after all
            problem, bar = stayed, inf
            if not interrupted:
                continue
            back = search(problem, 0)
            ended = replace(back, ending=ended.ending, findings=ended.findings, iterations=ended.iterations)
        ended = _with_colour(problem, ended)
        problem = problem.begun_at(ended.estimate)
        inside = [name for name, free in zip(names, ended.free, strict=False) if free]
        kept = _hold(_told(problem, inside, ended), inside, preference)
        if interrupted or (len(kept) == len(inside) and not under_way):
            minimum = replace(ended, findings=tuple(_after(steps, finding) for finding in ended.findings))
        elif len(kept) < len(inside):
            names = [name for name in names if name not in inside or name in kept]
            bar = ended.cost + _tolerable(ended)
            states, given = problem.states(problem.start), _put_back(problem.plant, inside, kept, known)
            stayed = problem_for(given, names, states)
            begun = {name: start.value(name) for name in inside} | known
            problem = problem_for(_put_back(given, inside, kept, begun), names, states)
            problem, bar = (problem, bar) if isfinite(_cost(problem)) else (stayed, inf)
    found, states = problem.plant, problem.states(problem.start)
    told = _told(problem if len(names) == len(asked) else problem_for(found, asked, states), asked, minimum)
    rows = table(found, start, names, asked, fixed, sheet, minimum, told)
    known_together = combinations(found, names, asked, minimum, told)
    unseen = minimum.ending is not Ending.INTERRUPTED and _shaft_unseen(
        minimum, found, names, lambda rigid, left: search(problem_for(rigid, left, states), LOOK)
    )
    words = [
        *([NO_SHAFT] if unseen else []),
        *at_bounds(minimum, names, found, limits, hidden, sheet),
        *in_words(told, names, found, shown, known_together),
        *hardly_told(rows, found),
    ]
    fit = minimum.fit(GreyBox(found, shown), tuple(names), "gn")
    return GreyBoxFit(
        **{f: getattr(fit, f) for f in Fit.__dataclass_fields__ if f not in ("message", "iterations")},
        iterations=steps,
        message="; ".join([*(sentence(finding).rstrip(".") for finding in fit.findings), *words]),
        table=rows,
        combinations=known_together,
        words=tuple(words),
        identifiability=told,
        segments=segments,
        states=tuple(states),
        weighting=weighting,
        limits=limits,
        cost=minimum.cost,
        colour=_colour(minimum, len(names)),
    )


LOOK = 20
"""Steps after which it is looked what the records tell: a search along what they do not tell finds no end."""
FLAT = 0.01
"""A search whose later steps have not lowered V by more than this part is down in the valley."""


def _tolerable(minimum: Minimum) -> float:
    """By how much V may rise where what records do not tell is held at its start: three standard deviations' worth.

    Where the residual is coloured these are wider, but a loss that shows is none to be tolerated.
    """
    noise, colour = 4.5 * minimum.noise_variance, _colour(minimum, len(minimum.free))
    return max(noise, min(noise * float(np.max(colour, initial=1.0)), FLAT * minimum.cost))


NO_SHAFT = "no shaft is seen in the records: one mass, rigid-motor, describes them as well; choose that"


def _shaft_unseen(
    minimum: Minimum, found: Plant, names: Sequence[str], search: Callable[[Plant, Sequence[str]], Minimum]
) -> bool:
    """Whether one mass without inductance is as good: what the others gain is what noise gives them (χ², at 95 %)."""
    from scipy.special import chdtri

    simpler = found.simpler(names)
    if simpler is None:
        return False
    _, left = simpler
    try:
        rigid = search(*simpler)
    except EmsidError:  # one mass is not even simulated
        return False
    noise = minimum.noise_variance * float(np.max(_colour(minimum, len(names))))
    return rigid.cost - minimum.cost <= 0.5 * noise * float(chdtri(len(names) - len(left), 0.05))


def _colour(minimum: Minimum, parameters: int) -> Array:
    coloured, white = (np.diag(c)[:parameters] for c in (minimum.covariance, minimum.white_covariance))
    return np.divide(coloured, white, out=np.ones(parameters), where=(white > 0) & np.isfinite(white))


def _segments(records: Record | Iterable[Record]) -> tuple[Record, ...]:
    whole = (records,) if isinstance(records, Record) else tuple(records)
    if not whole:
        raise DataError("no record to identify from")
    for other in whole[1:]:
        check_same_channels(whole[0], other)
    return tuple(segment for record in whole for segment in record.segments)


def _check_motion(segments: Sequence[Record]) -> None:
    """Refuse records in which nothing drives, nothing moves, or a sensor shows nothing but its noise."""
    first = segments[0]
    for names, side in ((first.input_names, "input"), (first.output_names, "output")):
        values = [getattr(segment, side) for segment in segments]
        together = [np.concatenate(values)] if side == "input" else values  # of several steps each may have its level
        if not any(np.ptp(v, axis=0).any() for v in together):
            what = "nothing drives it" if side == "input" else "nothing moves"
            raise DataError(
                f"{first.name}: {side} {', '.join(names)} stays at {values[0][0, 0]:g} throughout; {what}, "
                "and no parameter can be found from it"
            )
    if all(_is_noise(segments, channel) for channel in range(len(first.output_names))):
        raise DataError(
            f"{first.name}: output {', '.join(first.output_names)} is noise that has nothing to do with the input; "
            "nothing moves, and no parameter can be found from it"
        )


CHANCE = 0.05
"""How often noise may pass for motion, by either of two tests: rather that than a weak motion that passes for noise."""
SETTLING = (0.0, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
"""Time constants in samples of what may answer an input."""


def _is_noise(segments: Sequence[Record], channel: int, lags: int = 20) -> bool:
    """Whether an output is white (Ljung, Box, Biometrika 65, 1978) and uncorrelated with what could answer an input."""
    from scipy.signal import lfilter
    from scipy.special import chdtrc

    long = [segment for segment in segments if len(segment) > 2 * lags]
    if not long:
        return False

    def centred(signals: Sequence[Array]) -> list[Array]:
        mean = np.mean(np.concatenate(signals))
        return [signal - mean for signal in signals]

    def correlation(x: Sequence[Array], y: Sequence[Array]) -> float:
        size = np.sqrt(sum(float(a @ a) for a in x) * sum(float(b @ b) for b in y))
        return sum(float(a @ b) for a, b in zip(x, y, strict=True)) / size if size > 0 else 0.0

    y = centred([segment.output[:, channel] for segment in long])
    samples = sum(len(piece) for piece in y)
    colour = sum(correlation([p[:-lag] for p in y], [p[lag:] for p in y]) ** 2 for lag in range(1, lags + 1))
    if chdtrc(lags, samples * colour) < CHANCE:
        return False
    inputs = [centred([segment.input[:, k] for segment in long]) for k in range(long[0].input.shape[1])]
    decays = [np.exp(-1 / time) if time else 0.0 for time in SETTLING]
    answers = [correlation([lfilter([1.0], [1.0, -d], p) for p in u], y) ** 2 for u in inputs for d in decays]
    return bool(chdtrc(1, samples * max(answers)) > CHANCE / len(answers))


def _values(plant: Plant, fixed: Mapping[str, float | str]) -> dict[str, float]:
    """What is fixed, in SI units, whether it was given so or as a text with a unit."""
    return {
        name: read_number(f"{plant.name} {name}", value, find_handle(plant, name).parameter.unit)
        for name, value in fixed.items()
    }


def _asked(
    plant: Plant, free: Sequence[str] | None, fixed: Mapping[str, float], sheet: Mapping[str, Given]
) -> tuple[str, ...]:
    for name in (*(free or ()), *fixed, *sheet):
        find_handle(plant, name)
    for name, entry in sheet.items():
        if not isinstance(entry, Given):
            raise ModelError(f"the datasheet has {entry!r} for {name}; give a Given, or make it with `datasheet`")
    both = [name for name in free or () if name in fixed]
    if both:
        raise ModelError(f"{both[0]} is both free and fixed at {fixed[both[0]]:g}; choose one")
    for name, value in fixed.items():
        given = sheet.get(name)
        if given is not None and given.limits is not None and not given.limits[0] <= value <= given.limits[1]:
            raise ModelError(
                f"{name} is fixed at {value:g} and the datasheet has it within [{given.limits[0]:g}, "
                f"{given.limits[1]:g}]; correct one of them"
            )
    unknown = [name for name, given in sheet.items() if given.value is None]
    names = tuple(free) if free is not None else without_overlap(plant, (*plant.usual, *unknown), fixed)
    refuse_overlap(plant, (*names, *fixed))
    if not names:
        raise ModelError(f"no parameter of {plant.name} is free; it has {', '.join(plant.handles)}")
    return names


def _both_ways(name: str) -> str:
    """The parameter for both directions that one for a single direction is a part of."""
    return name.removesuffix(".forward").removesuffix(".backward")


Limits = dict[str, tuple[float, float]]


def _limits(
    plant: Plant, asked: Sequence[str], bounds: Mapping[str, tuple[float, float]], sheet: Mapping[str, Given]
) -> Limits:
    """The narrowest bounds that hold for every parameter that was asked for."""
    limits: Limits = {}
    for name in bounds:
        find_handle(plant, name)
        if name not in asked:
            raise ModelError(f"bounds for {name}, which is not free; free are {', '.join(asked)}")
    for name in asked:
        handle: Handle = plant.handles[name]
        low, high, unit = handle.lower, handle.upper, handle.parameter.unit
        if name in bounds:
            given_low, given_high = bounds[name]
            if not given_low <= given_high or given_high < low or given_low > high:
                raise ModelError(
                    f"bounds of {name} are {with_unit(f'[{given_low:g}, {given_high:g}]', unit)}; they must ascend "
                    f"within [{low:g}, {high:g}]"
                )
            low, high = max(low, given_low), min(high, given_high)
        given = sheet.get(name)
        if given is not None and given.limits is not None:
            sheet_low, sheet_high = given.limits
            if sheet_low > high or sheet_high < low:
                raise ModelError(
                    f"the datasheet has {name} within [{sheet_low:g}, {sheet_high:g}] and its bounds are "
                    f"{with_unit(f'[{low:g}, {high:g}]', unit)}; they contradict each other"
                )
            low, high = max(low, sheet_low), min(high, sheet_high)
        limits[name] = (low, high)
    return limits


def _check_start(plant: Plant, asked: Sequence[str], limits: Limits) -> None:
    for name in asked:
        value, (low, high) = plant.value(name), limits[name]
        if not low <= value <= high:
            bounds = with_unit(f"[{low:g}, {high:g}]", plant.handles[name].parameter.unit)
            raise ModelError(f"bounds {bounds} of {name} exclude its start {value:g}; widen them or move the start")


def _best_start(
    plant: Plant, asked: Sequence[str], limits: Limits, problem_for: Callable[[Plant, Sequence[str]], FreeRunError]
) -> Plant:
    """The plant as given, or moved to what a regression on the records says, whichever simulates better."""
    first = problem_for(plant, asked)
    driven = plant.driven
    if driven is None:
        return plant
    drive = driven.drive
    against = _currents_against(drive, first)
    channel, is_position = _motion_channel(first.signals)
    if channel is None:
        _refuse_signs(first, against)
        return plant
    zone = any("dead_zone" in name for name in asked)
    commanded = [
        replace(
            segment,
            input=drive.bent(drive.gain * drive.commands(segment.input))[:, None] / drive.gain,
            input_names=segment.input_names[:1],
            input_units=segment.input_units[:1],
        )
        for segment in first.segments
    ]

    def tried(motion: Motion, plant: DrivenPlant) -> tuple[float, float, Plant]:
        try:
            suggested = plant.put_motion(motion)
            moved = problem_for(plant.put({n: float(np.clip(suggested.value(n), *limits[n])) for n in asked}), asked)
            return _cost(moved), _cost(moved, channel), moved.plant
        except EmsidError:
            return inf, inf, plant

    likely = list(motions(commanded, channel, is_position, zone, drive.offset))
    turned = driven.turned()
    forward = [(motion, driven) for motion in likely if motion.gain / drive.gain > 0]
    backward = [(motion, turned) for motion in likely if motion.gain / turned.drive.gain > 0]
    with ThreadPoolExecutor(first.threads) as pool:
        costs = list(pool.map(lambda pair: tried(*pair), [*forward, *backward]))
    straight = [(_cost(first), _cost(first, channel), plant), *costs[: len(forward)]]
    turned_round = min((cost for _, cost, _ in costs[len(forward) :]), default=inf)
    if turned_round < WRONG_WAY * min(cost for _, cost, _ in straight):
        against.append(channel)
    _refuse_signs(first, against)
    return min(straight, key=lambda one: one[0])[-1]


def _currents_against(drive: Drive, problem: FreeRunError) -> list[int]:
    """The currents that fall where the voltage rises: a motor takes power, whatever it is like."""
    voltage = np.concatenate([drive.gain * drive.commands(segment.input) for segment in problem.segments])
    found = []
    for channel in (k for k, signal in enumerate(problem.signals) if signal is Signal.CURRENT):
        current = np.concatenate([segment.output[:, channel] for segment in problem.segments])
        size = float(np.std(voltage) * np.std(current))
        if float(np.mean((voltage - np.mean(voltage)) * current)) < -PASSIVE * size:
            found.append(channel)
    return found


def _refuse_signs(problem: FreeRunError, against: Sequence[int]) -> None:
    """Refuse outputs that go against the command."""
    if not against:
        return
    record = problem.segments[0]
    command, shown = record.input_names[0], [record.output_names[channel] for channel in sorted(against)]
    outputs = len(record.output_names)
    turned = [command] if len(shown) == outputs > 1 else shown
    raise DataError(
        f"{record.name}: {listed([repr(name) for name in shown])} {'go' if len(shown) > 1 else 'goes'} against "
        f"{command!r}; if that is how it was wired or logged, turn the sign of "
        f"{'one of them' if outputs == 1 else listed(turned)} (scale {' '.join(f'{name}=-1' for name in turned)})",
        arguments=("scale",),
    )


WRONG_WAY = 0.1
"""A plant whose drive is turned round simulates a record that much better only where a sign is wrong."""
PASSIVE = 0.2
"""Voltage and current of what takes power are not correlated the wrong way, but for chance and delays."""

SCAN = (0.12, 0.18, 0.25, 0.35, 0.5, 0.7, 1.4, 2.0, 2.8, 4.0)
"""By what factors a fine parameter is moved before the search: the error has many minima over a resonance."""


def _scan(
    rough: FreeRunError,
    names: Sequence[str],
    limits: Limits,
    problem_for: Callable[[Plant, Sequence[str], Sequence[Array]], FreeRunError],
) -> Plant:
    """The plant of a problem with each of the other parameters in turn moved to where it simulates best."""
    best, states = rough.plant, rough.states(rough.start)
    lowest = _cost(rough)
    with ThreadPoolExecutor(rough.threads) as pool:
        for name in (name for name in names if name not in rough.free):
            value = best.value(name)
            trials = [best.put({name: float(np.clip(factor * value, *limits[name]))}) for factor in SCAN]
            costs = list(pool.map(lambda trial: _cost(problem_for(trial, (), states)), trials))
            k = int(np.argmin(costs))
            if costs[k] < lowest:
                best, lowest = trials[k], costs[k]
    return best


def _motion_channel(signals: Sequence[Signal]) -> tuple[int | None, bool]:
    for k, signal in enumerate(signals):
        if signal is not Signal.CURRENT:
            return k, signal is Signal.POSITION
    return None, False


def _cost(problem: FreeRunError, channel: int | None = None) -> float:
    """The sum of squares of a problem at its start, or that of one output."""
    try:
        residuals = problem.residuals(problem.start)
    except Infeasible:
        return inf
    if channel is not None:
        residuals = [np.split(residual, len(problem.signals))[channel] for residual in residuals]
    cost = float(sum(np.sum(residual**2) for residual in residuals))
    return cost if isfinite(cost) else inf


def _preference(plant: Plant, asked: Sequence[str], sheet: Mapping[str, Given]) -> tuple[str, ...]:
    """In which order parameters are held: what a datasheet gives, what plants of this kind usually have known."""
    known = sorted(
        (n for n in asked if n in sheet and sheet[n].value is not None), key=lambda n: sheet[n].tolerance or inf
    )
    usual = [name for name in plant.usual if name in asked]
    return tuple(dict.fromkeys((*known, *usual, *reversed(asked))))


def _put_back(plant: Plant, asked: Sequence[str], kept: Sequence[str], known: Mapping[str, float]) -> Plant:
    """What is no longer estimated as the datasheet has it, if it does."""
    return plant.put({name: known[name] for name in asked if name not in kept and name in known})


def _told(problem: FreeRunError, names: Sequence[str], minimum: Minimum | None) -> Identifiability:
    """What the records tell of some parameters of a problem; without noise where nothing is known of that."""
    noise = 0.0 if minimum is None else float(np.sqrt(minimum.noise_variance))
    states = range(len(problem.free), len(problem.sizes))
    places = [problem.free.index(name) for name in names]
    jacobians = [jacobian[:, [*places, *states]] for _, jacobian in problem.exactly(problem.start)]
    return identifiability(jacobians, problem.sizes[places], names, noise)


def _hold(told: Identifiability, names: Sequence[str], preference: Sequence[str]) -> list[str]:
    """The parameters that are left when one after the other is held until the others can be told."""
    kept = list(names)
    while kept and (groups := told.without([name for name in names if name not in kept]).groups):
        kept.remove(min(groups[0], key=preference.index))
    return kept


def _search(
    problem: FreeRunError,
    limits: Limits,
    max_iterations: int,
    control: Control,
) -> Minimum:
    lower, upper = problem.within(limits)
    return gauss_newton(
        problem,
        problem.start,
        lower=lower,
        upper=upper,
        max_iterations=max_iterations,
        tolerance=1e-2,
        noise=problem.precision,
        names=problem.names,
        control=control,
    )


def _after(steps: int, finding: Finding) -> Finding:
    """A finding of the last round of a search, with the steps of all rounds."""
    return replace(finding, data={**finding.data, "steps": steps}) if "steps" in finding.data else finding


def _with_colour(problem: FreeRunError, minimum: Minimum) -> Minimum:
    """The covariance under coloured noise; where the sandwich finds more, the deviations are the sandwich's.

    To it comes what the free run itself is not sure of, which is all there is where the data are exact.
    """
    told = np.isfinite(np.diag(minimum.covariance))
    columns = np.flatnonzero(minimum.free & told)
    if minimum.rank < len(columns) or not len(columns):
        return minimum
    pieces, channels = [], len(problem.signals)
    for residual, jacobian in problem.exactly(minimum.estimate):
        parts = np.split(np.arange(len(residual)), channels)
        pieces += [(residual[part], jacobian[np.ix_(part, columns)]) for part in parts]
    covariance = coloured_covariance(pieces)
    within = np.ix_(columns, columns)
    sandwich, found = np.diag(minimum.covariance)[columns], np.diag(covariance)
    ratio = np.divide(sandwich, found, out=np.ones(len(columns)), where=found > 0)  # nothing is left of exact data
    wider = np.sqrt(np.maximum(ratio, 1.0))
    whole = minimum.covariance.copy()
    inverse = inverse_triangle(minimum.information.select(np.flatnonzero(told[minimum.free])).factor[:-1, :-1])
    whole[within] = covariance * np.outer(wider, wider) + problem.precision**2 * (inverse @ inverse.T)
    return replace(minimum, covariance=whole)
