"""Figures of a physical model: friction, dead zone, the times at which the motor sticks, likelihood profiles.

Tables of the parameters of a physical model, its equations, and what is missing in its record.

Plots of the dead zones and friction of a motor.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from emsid.errors import listed
from emsid.estimation.estimates import HALF_WIDTH, INCLUDES_ZERO
from emsid.models.plants.search.diagnostics import (
    Curve,
    Profile,
    cogging_curve,
    dead_zone_curve,
    friction_curve,
    stops,
)
from emsid.models.plants.search.result import Status
from emsid.record import concatenate
from emsid.report.document import (
    Axis,
    Band,
    Dash,
    Figure,
    Histogram,
    Ink,
    Level,
    Line,
    Mark,
    Plot,
    Points,
    Spans,
    Stroke,
    Table,
)
from emsid.report.numbers import both_directions, capital, first_up, number, prefixed, sentence, share_of, slug, within
from emsid.report.views.conventions import BAND, MEASURED, channel_axis, timeline, with_gaps
from emsid.report.views.record import with_residual
from emsid.units import in_unit, readable_unit, with_unit
from emsid.wording.lists import NOT_SHOWN
from emsid.wording.plants import interval

if TYPE_CHECKING:
    from emsid.models.plants.plant import Plant
    from emsid.models.plants.search.result import Estimate, GreyBoxFit
    from emsid.plant import DeadZoneLaw, FrictionLaw, Motor
    from emsid.record import Record


Array = NDArray[np.float64]

# A characteristic has this many points; data support a point up to this many neighbours away.
POINTS, NEIGHBOURS = 1001, 20
# Bars of the histogram behind it, of eleven points each.
BARS = POINTS // 11
# A point is drawn on the curve in each of this many stretches that has at least this many samples.
STRETCHES, ENOUGH = 31, 10
# A dead zone smaller than this fraction of the input range is also shown enlarged, to this multiple of its width.
SMALL, ENLARGED = 0.2, 3.0
# A likelihood profile is shown up to this multiple of the threshold of its interval.
HIGHEST = 3.0
# Standstills closer to each other than this fraction of the time axis are shaded as one.
CLOSE = 5e-4


def friction(fit: GreyBoxFit, *, name: str = "") -> Figure | None:
    """Friction over speed, including the viscous part, with its band and the speeds in the records.

    Args:
        fit: of a physical model.
        name: of the figure, by default after the model.

    Returns:
        None for a plant whose friction emsid does not know.
    """
    declared = fit.model.plant.friction_characteristic()
    if declared is None:
        return None
    curve = friction_curve(fit, POINTS)
    (forward, backward), (quantity, base) = declared.breakaway, declared.y
    speed = Axis(*declared.x)
    factor, unit = prefixed(max(float(np.max(np.abs(curve.y))), forward, backward), base)
    marks = _characteristic(curve, factor, quantity.lower())
    marks.append(Points(np.zeros(2), factor * np.array([-backward, forward]), "break-away", Ink.RED))
    return Figure(
        name or f"{slug(fit.model.name)}-friction",
        f"Friction of {fit.model.name}, including the viscous part, {_with_band(curve)}. Grey: histogram (logarithmic) "
        f"of the speed in the records used in the fit. Points: at least {ENOUGH} samples. Dotted: no "
        f"samples.{_assuming(fit, curve.x, _friction_of)}{_given(fit)}",
        (Plot(tuple(marks), _reaching(speed, curve), Axis(quantity, unit), height=1.6),),
    )


def dead_zone(fit: GreyBoxFit, *, name: str = "") -> Figure | None:
    """Output of the dead zone over its input, with its band.

    Args:
        fit: of a physical model.
        name: of the figure, by default after the model.

    Returns:
        None for a plant without a dead zone.
    """
    zone, curve = fit.model.plant.dead_zone_characteristic(), dead_zone_curve(fit, POINTS)
    if zone is None or curve is None:
        return None
    what = zone.x[0].removeprefix("Applied ").lower()
    ends = curve.x[[0, -1]]
    marks = _characteristic(curve, 1.0, "dead zone")
    marks.insert(1, Line(ends, ends, "without", Stroke(Ink.GREY, Dash.DASHED, 0.8)))
    applied, effective = Axis(*zone.x), Axis(*zone.y)
    plots = [Plot(tuple(marks), _reaching(applied, curve), effective, height=1.6)]
    edge = zone.edge
    if 0 < edge < SMALL * ends[1]:
        reach = ENLARGED * edge
        shown = np.abs(curve.x) <= reach
        edges = np.concatenate([each[shown] for each in (curve.y, curve.low, curve.high)])
        y_range = (float(np.nanmin(edges)), float(np.nanmax(edges)))  # a search that stalled has no band
        close = tuple(
            _part(mark, reach) if isinstance(mark, Points) else replace(mark, label="")
            for mark in marks
            if isinstance(mark, Line | Band | Points)
        )
        near = replace(applied, range=(-reach, reach))
        plots = [replace(plots[0], title="Whole range")]
        plots.append(Plot(close, near, replace(effective, range=y_range), "Enlarged", height=1.6))
    return Figure(
        name or f"{slug(fit.model.name)}-dead-zone",
        f"Dead zone on the {what} of {fit.model.name}, {_with_band(curve)}. Grey: histogram "
        f"(logarithmic) of the applied {what} in the records used in the fit. Points: at least {ENOUGH} samples."
        f"{_assuming(fit, curve.x, _dead_zone_of)}",
        tuple(plots),
        columns=len(plots),
    )


def cogging(fit: GreyBoxFit, *, name: str = "") -> Figure | None:
    """Cogging over a turn with its band.

    Args:
        fit: of a physical model.
        name: of the figure, by default after the model.

    Returns:
        None for a plant without it.
    """
    curve = cogging_curve(fit)
    if curve is None:
        return None
    (x, y) = curve.axes
    factor, unit = prefixed(float(np.max(np.abs(curve.y))), y[1])
    plot = Plot(tuple(_characteristic(curve, factor, y[0].lower())), Axis(*x), Axis(y[0], unit), height=1.6)
    return Figure(
        name or f"{slug(fit.model.name)}-cogging",
        f"Cogging torque of {fit.model.name} over a turn, {_with_band(curve)}. Grey: histogram (logarithmic) of the "
        "angle in the records used in the fit.",
        (plot,),
    )


def characteristic(curve: Curve) -> Figure:
    """A characteristic of a plant with its band."""
    x, y = curve.axes
    plot = Plot(tuple(_characteristic(curve, 1.0, y[0].lower())), _reaching(Axis(*x), curve), Axis(*y), height=1.6)
    return Figure("characteristic", f"{y[0]} of {curve.of}, {_with_band(curve)}.", (plot,))


def sticking(fit: GreyBoxFit, *, name: str = "") -> Figure:
    """Measured and simulated outputs on the records used in the fit, residuals, and times at which the motor sticks.

    Args:
        fit: of a physical model.
        name: of the figure, by default after the model.
    """
    record = concatenate(fit.segments)
    t, samples = timeline(record)
    simulated = np.concatenate(fit.simulated())
    standstills = _standstills(fit, record, t, samples)
    subject = fit.model.plant.body
    shaded = [Spans(standstills, f"the {subject} sticks")] if len(standstills) else []
    plots: list[Plot] = []
    for k, quantity in enumerate(record.output_names):
        measured, run = (with_gaps(values[:, k], samples) for values in (record.output, simulated))
        plots += with_residual(t, measured, run, channel_axis(quantity, record.output_units[k]), "simulated", shaded)
    duration = float(np.sum(np.diff(standstills))) if len(standstills) else 0.0
    sticks = (
        f"shaded: the simulated {subject} sticks, {duration:.3g} s in all."
        if len(standstills)
        else f"the simulated {subject} never sticks."
    )
    return Figure(
        name or f"{slug(fit.model.name)}-sticking",
        f"{fit.model.name} on {record.name}, used in the fit; {sticks}",
        tuple(plots),
        shared_x=True,
    )


def likelihood(fit: GreyBoxFit, profile: Profile, *, name: str = "") -> Figure:
    """The likelihood profile of a parameter and its quadratic approximation, with their intervals.

    Args:
        fit: of a physical model.
        profile: of one of its parameters.
        name: of the figure, by default after model and parameter.
    """
    x = np.linspace(profile.values[0], profile.values[-1], POINTS)
    curve = profile.between(x)
    quadratic = ((x - profile.estimate) / profile.standard_error) ** 2
    top = HIGHEST * profile.limit
    low, high = x[(curve <= top) | (quadratic <= top)][[0, -1]]
    margin = 0.02 * (high - low)
    reach = (float(low - margin), float(high + margin))
    shown = profile.deviance <= top
    parameter = fit.model.plant.handles[profile.name].parameter
    percent = f"{100 * profile.level:g} %"
    marks: list[Mark] = [
        Spans(np.clip(profile.interval, *reach).reshape(1, 2), f"{percent} interval"),
        Line(x, curve, "profile", Stroke(Ink.BLUE, width=1.4)),
        Line(x, quadratic, "quadratic approximation", Stroke(Ink.RED, Dash.DASHED)),
        Points(profile.values[shown], profile.deviance[shown], "fits of all other parameters"),
        Level(profile.limit, f"{percent} threshold"),
    ]
    half = float(np.sqrt(profile.limit)) * profile.standard_error
    approximate = interval((profile.estimate - half, profile.estimate + half), profile.unit)
    beside = f"the standard error alone gives {approximate}"
    if profile.estimate in fit.limits[profile.name]:
        beside = "the search ended at a bound, so there is no standard error"
        del marks[2]
    return Figure(
        name or f"{slug(fit.model.name)}-profile-{slug(profile.name)}",
        f"Likelihood profile of {profile.name} of {fit.model.name}: the other parameters are refitted at each value. "
        f"The {percent} interval is {interval(profile.interval, profile.unit)}; {beside}.",
        (
            Plot(
                tuple(marks),
                Axis(first_up(parameter.description), parameter.unit, range=reach),
                Axis("Deviance", "1", range=(-0.03 * top, top)),
                height=1.6,
            ),
        ),
    )


def _characteristic(curve: Curve, factor: float, label: str) -> list[Mark]:
    """A curve with its band and a histogram of the data; dotted where there are no data nearby."""
    near = np.convolve(curve.support > 0, np.ones(2 * NEIGHBOURS + 1), "same") > 0
    y = factor * curve.y
    stroke = Stroke(Ink.BLUE, width=1.4)
    step = curve.x[1] - curve.x[0]
    edges = np.linspace(curve.x[0] - step / 2, curve.x[-1] + step / 2, BARS + 1)
    heights = np.log1p(np.histogram(curve.x, edges, weights=curve.support)[0])
    marks: list[Mark] = [Histogram(edges, heights, "in the records", backdrop=True)]
    if _has_band(curve):
        marks.append(Band(curve.x, factor * curve.low, factor * curve.high, BAND))
    if not near.all():
        marks.append(Line(curve.x, y, "no data", replace(stroke, dash=Dash.DOTTED)))
    if near.any():
        marks.append(Line(curve.x, np.where(near, y, np.nan), label, stroke))
    dots = _supported(curve)
    if len(dots):
        marks.append(Points(curve.x[dots], y[dots], "with data", Ink.NAVY))
    return marks


def _has_band(curve: Curve) -> bool:
    return bool(np.any(curve.high > curve.low))


def _with_band(curve: Curve) -> str:
    """The part of a caption about the band; a curve without estimated parameters has none."""
    return (
        "with 95 % confidence band"
        if _has_band(curve)
        else "without band, because none of its parameters was estimated"
    )


def _supported(curve: Curve) -> NDArray[np.intp]:
    """Indices of points of a curve: the median of every stretch of x with enough samples, except at jumps."""
    dots = []
    jumps = np.abs(np.gradient(curve.y)) > 0.1 * np.ptp(curve.y)
    for stretch in np.array_split(np.arange(len(curve.x)), STRETCHES):
        samples = np.cumsum(np.where(jumps, 0, curve.support)[stretch])
        if samples[-1] >= ENOUGH:
            dots.append(stretch[np.searchsorted(samples, samples[-1] / 2)])
    return np.array(dots, dtype=np.intp)


def _part(points: Points, reach: float) -> Points:
    inside = np.abs(points.x) <= reach
    return Points(points.x[inside], points.y[inside], ink=points.ink)


def _friction_of(plant: Plant, x: Array) -> Array:
    friction = plant.friction_characteristic()
    return np.zeros(len(x)) if friction is None else friction.law(x)


def _dead_zone_of(plant: Plant, x: Array) -> Array:
    zone = plant.dead_zone_characteristic()
    return x if zone is None else np.asarray(zone.law(x))


def _assuming(fit: GreyBoxFit, x: Array, law: Callable[[Plant, Array], Array]) -> str:
    """The kept parameters with their values, if a curve at ``x`` depends on them; the band does not include them."""
    identifiability, plant = fit.identifiability, fit.model.plant
    kept = [row for row in fit.table if row.status is Status.KEPT]
    if not kept:
        return ""
    if identifiability is not None:
        some = x[:: max(len(x) // 8, 1)]
        slopes = []
        for name, size in zip(identifiability.names, identifiability.sizes.tolist(), strict=True):
            value = plant.value(name)
            step = 1e-6 * size * (1 if value < plant.handles[name].upper else -1)
            slopes.append((law(plant.with_values({name: value + step}), some) - law(plant, some)) * (size / step))
        if all(identifiability.determines(slope) for slope in np.array(slopes).T if np.any(slope)):
            return ""
    return (
        f" Curve and band depend on kept values: {_values(kept)}. The data determine only combinations with "
        f"{'this parameter' if len(kept) == 1 else 'these parameters'}."
    )


def _given(fit: GreyBoxFit) -> str:
    given = [row for row in fit.table if row.status is Status.FIXED]
    return f" Fixed values: {_values(given)}." if given else ""


def _values(rows: Sequence[Estimate]) -> str:
    return listed([f"{row.name} = {with_unit(plain(row.value), row.unit)}" for row in rows])


def _reaching(axis: Axis, curve: Curve) -> Axis:
    return replace(axis, range=(float(1.02 * curve.x[0]), float(1.02 * curve.x[-1])))


def _standstills(fit: GreyBoxFit, record: Record, t: Array, samples: NDArray[np.intp]) -> Array:
    """(n, 2) stretches of the time axis of a figure in which the motor sticks; close stretches are joined."""
    if fit.model.plant.friction_characteristic() is None:
        return np.zeros((0, 2))
    place = t[np.flatnonzero(samples >= 0)]  # position of every sample on the axis
    first = np.cumsum([0, *map(len, fit.segments[:-1])])
    moved = place[first] - [segment.time[0] for segment in fit.segments]
    found = [[here.start + moved[here.segment], here.end + moved[here.segment] + record.dt] for here in stops(fit)]
    close = CLOSE * float(t[-1] - t[0])
    merged: list[list[float]] = []
    for stretch in found:
        if merged and stretch[0] - merged[-1][1] < close:
            merged[-1][1] = stretch[1]
        else:
            merged.append(stretch)
    return np.array(merged, dtype=float).reshape(-1, 2)


_MEANINGS = {
    Status.CONDITIONAL: "given …: correct only if these values are correct, because the data determine only "
    "combinations with them; the interval does not include their uncertainty",
    Status.ASSUMING: "assuming …: nobody gave or measured these values, and the estimate scales with them",
    Status.KEPT: "not identifiable: the data do not determine this parameter, so it was kept at its start value",
    Status.UNDETERMINED: "not determined by these data: the value is only the one at which the search ended",
    Status.FIXED: "fixed: given by the user and not estimated",
    Status.BUILT_IN: "built in: neither estimated nor given",
    Status.OF_PLANT: "of the plant given: not estimated",
    Status.CHOSEN: "chosen by the search among a few values",
    Status.AT_BOUND: "at a bound: the search ended at a limit of the parameter; its interval, if any, is that of the "
    "likelihood profile",
}
_TOO_WIDE_MEANS = f"{INCLUDES_ZERO}: the parameter may be zero"


def physical_table(fit: GreyBoxFit) -> tuple[Table, ...]:
    """Every physical parameter with its unit, interval and datasheet value; then the identifiable combinations.

    Args:
        fit: of a physical model.

    Returns:
        The table of parameters, one of those that differ by record and one of combinations, where there are any.
    """
    sheet = any(row.datasheet is not None for row in fit.table)
    cells = [_parameter_row(row, sheet) for row in fit.shared]
    statuses = dict.fromkeys(row.status for row in fit.table)
    meanings = [_MEANINGS[status] for status in statuses if status in _MEANINGS]
    meanings += [_TOO_WIDE_MEANS] * any(row.may_be_zero for row in fit.shared)
    parameters = Table(
        (
            "Parameter",
            "Meaning",
            "Symbol",
            "Unit",
            "Status",
            "Estimate",
            "±\u00a0[%]",
            *(("Datasheet",) if sheet else ()),
        ),
        tuple(cells),
        f"Physical parameters of {fit.model.name} with 95 % intervals.",
        sentence("; ".join(meanings)),
        text_columns=5,
    )
    tables = (parameters, *([own_parameters(fit)] if fit.by_record else []))
    if not fit.combinations:
        return tables
    combinations = Table(
        ("Quantity", "Formula", "Unit", "Estimate", "±\u00a0[%]"),
        tuple(
            both_directions(
                (
                    capital(each.quantity.name) if " " not in each.quantity.name else first_up(each.quantity.name),
                    each.quantity.formula,
                    readable_unit(each.quantity.unit),
                    *(
                        _with_interval(each.quantity.value, HALF_WIDTH * each.standard_error)
                        if fit.shows(each.quantity)
                        else (NOT_SHOWN, "")
                    ),
                )
                for each in fit.combinations
            )
        ),
        f"Combinations of parameters of {fit.model.name} that the data determine without the kept values, with "
        f"95 % intervals.",
        text_columns=3,
    )
    return (*tables, combinations)


def own_parameters(fit: GreyBoxFit) -> Table:
    """The parameters that differ by record, a row for every record.

    Args:
        fit: of a physical model with such parameters.
    """
    first = next(iter(fit.by_record.values()))
    heads = [cell for name, row in first.items() for cell in (in_unit(name, row.unit), "±\u00a0[%]", "Status")]
    return Table(
        ("Record", *heads),
        tuple(
            (record, *(cell for row in rows.values() for cell in (*_value(row), row.how)))
            for record, rows in fit.by_record.items()
        ),
        f"Parameters of {fit.model.name} that differ by record, with 95 % intervals.",
        text_columns=1,
    )


def plant_equations(fit: GreyBoxFit) -> tuple[str, ...]:
    """The equations of a plant in symbols, if it has any, and the values of all its parameters."""
    symbols, numbers = fit.model.plant.equations(), fit.model.equation()
    return (symbols, numbers) if symbols else (numbers,)


def units_taken(fit: GreyBoxFit) -> str:
    """A warning if a record has no units; empty if it has."""
    commands = None if fit.model.plant.channels is None else 1  # codes have no unit
    unsaid = [
        name
        for segment in fit.segments[:1]
        for name, unit in zip(
            (*segment.input_names[:commands], *segment.output_names),
            (*segment.input_units[:commands], *segment.output_units),
            strict=True,
        )
        if not unit
    ]
    if not unsaid:
        return ""
    they = "they are" if len(unsaid) > 1 else "it is"
    return (
        f"The record has no unit for {listed(unsaid)}; {they} read as SI. If this is wrong, the estimates have wrong "
        "units and scales."
    )


def _parameter_row(row: Estimate, sheet: bool) -> tuple[str, ...]:
    given = "" if row.datasheet is None else plain(row.datasheet)
    words = (row.name, first_up(row.description), row.symbol, readable_unit(row.unit), row.how)
    return (*words, *_value(row), *((given,) if sheet else ()))


def _value(row: Estimate) -> tuple[str, str]:
    """The value of a parameter and half its interval in percent."""
    if row.estimated and row.standard_error is not None:
        return _with_interval(row.value, HALF_WIDTH * row.standard_error)
    if row.status is Status.AT_BOUND and row.interval is not None:
        return f"{plain(row.interval[0])} to {plain(row.interval[1])}", "–"
    return plain(row.value), "–"


def _with_interval(value: float, half: float) -> tuple[str, str]:
    if not np.isfinite(half):
        return plain(value), "unknown"
    return within(value, half), share_of(half, value)


def plain(value: float) -> str:
    """A value without an interval."""
    return "∞" if value == np.inf else number(value)


def nonlinearities(motor: Motor) -> Figure:
    """Dead zones (4.9) and friction torques (4.7) of a motor, as in Figure 4.2, as far as it has them.

    A motor without any is drawn with zero friction.
    """
    frictions = ((motor.rotor_friction, "rotor"), (motor.load_friction, "load"))
    acting = [(friction, where) for friction, where in frictions if max(friction.breakaway) > 0]
    plots = [
        *(
            _dead_zone(zone, quantity, unit)
            for zone, quantity, unit in (
                (motor.voltage_dead_zone, "voltage", "V"),
                (motor.torque_dead_zone, "torque", "N*m"),
            )
            if zone is not None
        ),
        *(_friction(friction, where) for friction, where in acting),
    ] or [_friction(*frictions[0])]
    return Figure(
        "nonlinearities",
        "Dead zone and friction of the motor. The output of the dead zone is zero between its break points. Friction "
        "at standstill takes any value up to break-away.",
        tuple(plots),
        columns=len(plots) if len(plots) < 4 else 2,
    )


def _dead_zone(zone: DeadZoneLaw, quantity: str, unit: str) -> Plot:
    reach = 3 * max(-zone.b_l, zone.b_r) or 1.0
    x = np.array([-reach, zone.b_l, zone.b_r, reach])
    return Plot(
        (
            Line(x[[0, -1]], x[[0, -1]], "D(v) = v", Stroke(Ink.GREY, Dash.DASHED, 0.8)),
            Line(x, zone(x), "dead zone (4.9)", MEASURED),
        ),
        Axis(f"Applied {quantity} v", unit),
        Axis(f"Effective {quantity} D(v)", unit),
        f"Dead zone on the {quantity}",
    )


def _friction(friction: FrictionLaw, where: str) -> Plot:
    forwards = friction.reach * np.concatenate([[1e-12], np.linspace(0, 1, 200)[1:]])
    w = np.concatenate([-forwards[::-1], forwards])
    factor, unit = prefixed(max(friction.breakaway), "N*m")
    forward, backward = friction.breakaway
    return Plot(
        (
            Line(w, factor * friction.torque(w), "friction", MEASURED),
            Points(np.zeros(2), factor * np.array([-backward, forward]), "break-away", Ink.RED),
        ),
        Axis("Speed ω", "rad/s"),
        Axis("Friction torque", unit),
        f"Friction on the {where}",
    )
