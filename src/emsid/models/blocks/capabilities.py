"""What cascades of filters and static maps can do; see `emsid.models.capabilities`.

Their characteristics are gain, time constants and dead zone, with intervals. Their linear part has the slopes at rest
in place of the static maps. `CascadeStepper` runs all blocks of a sample in one compiled call. In C the filters are
statements, and the static maps are tables of polynomials between break points.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from math import isfinite
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.errors import ModelError
from emsid.estimation.fit import Fit
from emsid.findings import Finding
from emsid.models.bands import POINTS, Band, BandedCurve, banded_curve
from emsid.models.blocks import fitting
from emsid.models.blocks.cascade import Cascade, CascadeState
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.static_maps import StaticMap
from emsid.models.blocks.static_maps.tables import Tables, tables_of, value_at
from emsid.models.c_form import SHIFT, CForm, entering, map_tables, number
from emsid.models.capabilities import Capabilities, MapInUse, Modes
from emsid.models.characteristics import Characteristic, by_estimate, check_channel, gain_unit, modes
from emsid.models.input_path import InputPath, enter
from emsid.models.linear.state_space import observer_form
from emsid.models.linear.system import LinearSystem
from emsid.models.refit_data import Budget, Data
from emsid.models.stepping import PlainStepper, Stepper
from emsid.models.visited import Needs, RestsOn, Visited
from emsid.record import Record

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


class Blocks(NamedTuple):
    """The blocks of a cascade, one after the other.

    Attributes:
        maps: (n,) the number of the static map of each block; −1 for a filter.
        first: (n + 1,) where the state of each block begins, and the number of states.
        above, below: numerators and denominators of all filters; that of a block begins at its first state plus its
            number, as it has one coefficient more than states.
    """

    maps: Integers
    first: Integers
    above: Array
    below: Array


class CascadeStepper(Stepper):
    """A cascade of filters and static maps."""

    __slots__ = ("_blocks", "_offsets", "_past", "_states", "_steps", "_tables", "_taps")

    def __init__(self, model: Cascade, state: CascadeState, tables: Tables) -> None:
        """
        Args:
            model: what runs.
            state: where it begins.
            tables: of its static maps.
        """
        super().__init__(model, 1, 1)
        path = InputPath(model.delay, model.oversampling)
        self._blocks, self._tables, self._taps = blocks_of(model), tables, path.taps
        self._offsets = np.array([model.input_offset, model.output_offset])
        self._past, self._states = np.append(0.0, state.inputs), np.array(state.blocks, dtype=float)
        self._steps = np.empty(path.rate)

    @classmethod
    def of(cls, model: Cascade, state: CascadeState) -> Stepper:
        """The stepper of a cascade; a plain one where a block is a function of the user."""
        maps = [block for block in model.blocks if isinstance(block, StaticMap)]
        tables = tables_of(maps)
        if tables is None or not all(isinstance(block, (Rational, StaticMap)) for block in model.blocks):
            return PlainStepper(model, state)
        return cls(model, state, tables)

    def _advance(self) -> None:
        take(
            self._taps,
            self._past,
            self._steps,
            self._offsets,
            self._blocks,
            self._tables,
            self._states,
            self._u,
            self._y,
        )

    @property
    def blocks(self) -> Blocks:
        """The blocks as numbers."""
        return self._blocks

    @property
    def tables(self) -> Tables:
        """The static maps as numbers."""
        return self._tables

    @property
    def numbers(self) -> tuple[Array, Array, Array, Array]:
        """Taps of the input, offsets of input and output, past inputs, states of the blocks."""
        return self._taps, self._offsets, self._past.copy(), self._states.copy()

    @property
    def state(self) -> CascadeState:
        """The present state."""
        return CascadeState(self._past[1:].copy(), self._states.copy())


def blocks_of(cascade: Cascade) -> Blocks:
    """The blocks of a cascade of filters and static maps."""
    maps, first = np.full(len(cascade.blocks), -1), np.zeros(len(cascade.blocks) + 1, dtype=np.int64)
    above: list[Array] = []
    below: list[Array] = []
    count = 0
    for k, block in enumerate(cascade.blocks):
        first[k + 1] = first[k] + block.states
        b = a = np.zeros(block.states + 1)
        if isinstance(block, Rational):
            b, a = block.transfer
        else:
            maps[k], count = count, count + 1
        above.append(b)
        below.append(a)
    return Blocks(maps, first, np.concatenate(above), np.concatenate(below))


@njit(nogil=True)
def take(
    taps: Array,
    past: Array,
    steps: Array,
    offsets: Array,
    blocks: Blocks,
    tables: Tables,
    states: Array,
    u: Array,
    y: Array,
) -> None:
    """Write the output of one sample into y (1,), and leave the states after it."""
    maps, first, above, below = blocks
    enter(taps, past, u[0], steps)
    for step in range(len(steps)):
        x = steps[step] - offsets[0]
        for k in range(len(maps)):
            if maps[k] >= 0:
                x = value_at(tables, maps[k], x)
                continue
            s, c, n = first[k], first[k] + k, first[k + 1] - first[k]
            out = above[c] * x + (states[s] if n else 0.0)
            for j in range(n):
                following = states[s + j + 1] if j + 1 < n else 0.0
                states[s + j] = following + above[c + j + 1] * x - below[c + j + 1] * out
            x = out
        if step == 0:
            y[0] = x + offsets[1]


def of_cascade(fit: Fit[Cascade], record: Record) -> tuple[Characteristic, ...]:
    """Gain and slowest time constant, and the break points of a dead zone."""
    model = fit.model
    inside = record.dt / model.oversampling
    found = [_quantity(fit, "gain", _gain, gain_unit(record))]
    found += modes(partial(_quantity, fit), _poles_of_cascade, model, inside)
    found += _edges(fit, record)
    return tuple(each for each in found if isfinite(each.value) or not each.shown)


def _poles_of_cascade(model: Cascade) -> NDArray[Any]:
    return np.concatenate([np.empty(0), *(block.poles for block in model.blocks if isinstance(block, Rational))])


def _edges(fit: Fit[Cascade], record: Record) -> list[Characteristic]:
    """The break points of the first static map, where that is a dead zone, as levels of the input."""
    blocks = fit.model.blocks
    k = next((k for k, block in enumerate(blocks) if isinstance(block, StaticMap)), None)
    if k is None or not {"b_l", "b_r"} <= set(blocks[k].names) or not _gain_before(fit.model, k):
        return []
    sides = ("b_l", "b_r") if _gain_before(fit.model, k) > 0 else ("b_r", "b_l")
    names = zip(("backward", "forward"), sides, strict=True)
    found = (
        (
            way,
            _quantity(fit, f"dead zone {name}", partial(_edge, k, blocks[k].names.index(side)), record.input_units[0]),
        )
        for way, (name, side) in zip((-1, 1), names, strict=True)
    )
    visited = Visited(record.input[:, 0], np.empty(0))
    judged = [(each, visited.shows(RestsOn(Needs.THRESHOLD, way), way * each.value)) for way, each in found]
    return [each if approached else each.unknown() for each, approached in judged]


def _edge(block: int, number: int, model: Cascade) -> float:
    """The constant input at which a static map meets one of its break points."""
    edge = float(model.blocks[block].parameters[number])
    return edge / (_gain_before(model, block) or np.nan) + model.input_offset


def _gain_before(model: Cascade, block: int) -> float:
    """The gain at DC from the input to a static map; zero where a filter between them blocks DC or is unknown."""
    gain = 1.0
    for each in model.blocks[:block]:
        if not isinstance(each, Rational):
            return 0.0
        numerator = float(np.sum(each.numerator))
        rounding = 1e-9 * float(np.sum(np.abs(each.numerator)))
        gain *= numerator / (1 + float(np.sum(each.denominator))) if abs(numerator) > rounding else 0.0
    return gain


def _gain(model: Cascade) -> float:
    """Slope from input to output, in a stretch where the maps are straight."""
    factors = [
        block.gain if isinstance(block, Rational) else block.steepness
        for block in model.blocks
        if isinstance(block, Rational | StaticMap)
    ]
    return float(np.prod(factors))


def _quantity(fit: Fit[Cascade], name: str, quantity: Callable[[Cascade], float], unit: str) -> Characteristic:
    """A quantity of the model, whose free parameters are a part of its parameters."""
    model = fit.model
    at = [model.names.index(each) for each in fit.names]

    def of(theta: Array) -> float:
        whole = np.array(model.parameters, dtype=float)
        whole[at] = theta
        return quantity(model.with_parameters(whole))

    return by_estimate(fit, name, of, unit)


def linear_part(model: Cascade, at: float) -> LinearSystem:
    """The filters with the slopes of the maps at rest; in steps of the blocks, with the delay aside."""
    if model.dt is None:
        raise ModelError(f"{model.name} has no sample time; make it with dt=… in s")
    dt = model.dt / model.oversampling
    system = LinearSystem(
        np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1)), dt, model.delay * model.dt, model.name
    )
    x = at - model.input_offset
    for block in model.blocks:
        if isinstance(block, Rational):
            b, a = block.transfer
            own, columns = observer_form(a, [b])
            n, m = len(system.a), len(own)
            joined = np.zeros((n + m, n + m))
            joined[:n, :n], joined[n:, :n], joined[n:, n:] = system.a, columns @ system.c, own
            entering = np.vstack([system.b, columns @ system.d])
            output = np.hstack([b[0] * system.c, np.eye(1, m)])
            system = replace(system, a=joined, b=entering, c=output, d=b[0] * system.d)
        else:
            slope = float(block.slope(np.array([x]))[0])  # type: ignore[attr-defined]
            system = replace(system, c=slope * system.c, d=slope * system.d)
        x = block.resting(x)[1]
    return system


def c_form(stepper: CascadeStepper) -> CForm:
    """The form in C of a cascade, from where its stepper is."""
    maps, first, above, below = stepper.blocks
    lines = []
    for k, which in enumerate(maps.tolist()):
        if which >= 0:
            lines.append(f"        x = map_value({which}, x);")
            continue
        s, c, n = int(first[k]), int(first[k]) + k, int(first[k + 1] - first[k])
        lines.append(f"        out = {number(above[c])} * x" + (f" + s->blocks[{s}];" if n else ";"))
        for j in range(n):
            following = f"s->blocks[{s + j + 1}] + " if j + 1 < n else ""
            update = f"{following}{number(above[c + j + 1])} * x - {number(below[c + j + 1])} * out"
            lines.append(f"        s->blocks[{s + j}] = {update};")
        lines.append("        x = out;")
    taps, offsets, past, blocks = stepper.numbers
    rate = len(taps)
    out = "    real out;\n" if any(which < 0 for which in maps) else ""
    step = (
        f"    real steps[{rate}];\n    real x;\n{out}    int i;\n    int k;\n"
        + entering(taps)
        + f"    for (k = 0; k < {rate}; ++k) {{\n        x = steps[k] - {number(offsets[0])};\n"
        + "\n".join(lines)
        + f"\n        if (k == 0) {{\n            y[0] = x + {number(offsets[1])};\n        }}\n    }}\n"
    )
    tables, functions = map_tables(stepper.tables) if (maps >= 0).any() else ((), "")
    define = f"#define PAST {len(past)}\n\n"
    state = (("past", past), ("blocks", blocks))
    return CForm(1, 1, state, step, (("taps", taps.ravel()), *tables), f"{define}{SHIFT}\n{functions}")


Complex = NDArray[np.complex128]


class OfCascades(Capabilities[Cascade]):
    """Cascades: Wiener, Hammerstein, and longer ones."""

    kind = "cascade"
    model = Cascade
    same_in_every_fit = True
    estimators: ClassVar = {Cascade: fitting.fit_cascade}

    def stepper(self, model: Cascade, state: Any, inputs: int) -> Stepper:
        return CascadeStepper.of(model, state)

    def c_form(self, stepper: Any, *, single: bool = False, parameters: Sequence[str] = ()) -> CForm:
        return c_form(stepper)

    def linear_part(self, model: Cascade, at: float) -> LinearSystem:
        return linear_part(model, at)

    def frequency_response(
        self, model: Cascade, f: Array, dt: float, output: int, input: int, around: float
    ) -> Complex:
        """That of the filters in a row, without the maps."""
        check_channel(model, "output", output, 1)
        check_channel(model, "input", input, 1)
        filters = list(model.filters.values())
        if not filters:
            return super().frequency_response(model, f, dt, output, input, around)
        inside, z = dt / model.oversampling, np.exp(-2j * np.pi * f * dt)
        return np.asarray(z**model.delay * np.prod([block.response(f, inside) for block in filters], axis=0))

    def modes(self, model: Cascade) -> Modes:
        filters = list(model.filters.values())
        inside = sum(block.delay for block in filters) // model.oversampling
        pairs = {k + 1: (list(block.poles), list(block.zeros)) for k, block in model.filters.items()}
        return Modes([pole for block in filters for pole in block.poles], pairs, model.delay + inside)

    def maps_in_use(self, model: Cascade, record: Record) -> tuple[MapInUse, ...]:
        """The maps with their inputs from rest at the first input of every segment."""
        with np.errstate(all="ignore"):
            signals = [model.signals_from_rest(segment.input[:, 0]) for segment in record.segments]
        return tuple(
            MapInUse(
                np.concatenate([signal[k] for signal in signals]),
                k + 1,
                block.value,
                block.marks()[0],
                partial(_at_rest_after, model, k),
            )
            for k, block in model.maps.items()
        )

    def judged_maps(self, model: Cascade, record: Record) -> tuple[MapInUse, ...]:
        return self.maps_in_use(model, record)

    def static_map(self, fit: Fit[Cascade], record: Record, map: int = 0, level: float = 0.95) -> Band:
        """One of its static maps, over the signal that enters it in the record."""
        found = list(fit.model.maps)
        if not 0 <= map < len(found):
            raise ModelError(f"{fit.model.name} has no static map {map}; it has {len(found)}, counted from 0")
        k = found[map]
        entering = np.concatenate([fit.model.signals_from_rest(segment.input[:, 0])[k] for segment in record.segments])
        x = np.linspace(float(entering.min()), float(entering.max()), POINTS)
        value, error = fitting.static_band(fit, k, x).T
        return Band(x, value, error if fit.has_bands else np.full(len(x), np.nan), level)

    def curves(self, fit: Fit[Cascade], record: Record) -> Iterator[Callable[[], list[BandedCurve]]]:
        """The maps; a cascade has no units between its blocks."""
        maps = len(fit.model.maps)
        names = [f"map {k + 1}" for k in range(maps)] if maps > 1 else ["the map"]

        def of_maps() -> list[BandedCurve]:
            bands = [self.static_map(fit, record, k) for k in range(len(names))]
            return [
                banded_curve(fit, record, "static map", band, (f"input of {name}", ""), (f"output of {name}", ""))
                for band, name in zip(bands, names, strict=True)
            ]

        yield of_maps

    def characteristics(self, fit: Fit[Cascade], record: Record) -> tuple[Characteristic, ...]:
        return of_cascade(fit, record)

    def advice(self, fit: Fit[Cascade], record: Record) -> tuple[Finding, ...]:
        from emsid.models.blocks.search.estimation import advice

        return advice(fit, record)

    def section(self, fit: Fit[Cascade]) -> str:
        return "blocks"

    def refitted(self, fit: Fit[Cascade], data: Data, budget: Budget) -> Fit[Cascade]:
        if budget is Budget.LAST:
            from emsid.models.blocks.search.estimation import asked, topology_of

            return asked(topology_of(fit.model), data.given).continued(fit.model, data.records, data.control)
        minimum, problem = fitting.search(
            fit.model,
            data.records,
            fixed=fitting.fixed_in(fit),
            max_iterations=budget.steps,
            least_saving=budget.saving,
            control=data.control.quietly(),
            left_out=data.by_segment,
        )
        return fit.at(problem.model(minimum.estimate))

    def specification(self, fit: Fit[Cascade]) -> tuple[Any, dict[str, Any]]:
        return fit.model, {}


def _at_rest_after(model: Cascade, k: int, value: float) -> float:
    """The output at rest where the output of block k is constant."""
    for block in model.blocks[k + 1 :]:
        _, value = block.resting(value)
    return value + model.output_offset
