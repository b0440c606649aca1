"""What feedback models can do; see `emsid.models.capabilities`.

They run sample by sample in `FeedbackStepper`. In C the linear system is statements without zeros, and the static maps
are tables.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.errors import ModelError
from emsid.estimation.compiled import read_only
from emsid.estimation.fit import Fit
from emsid.models.bands import POINTS, BandedCurve, banded_curve
from emsid.models.c_form import SHIFT, CForm, entering, map_tables, number, total
from emsid.models.capabilities import Capabilities, MapInUse
from emsid.models.characteristics import check_channel
from emsid.models.feedback import curves, fitting
from emsid.models.feedback.curves import map_band
from emsid.models.feedback.kernels import LoopSignals, Tables, run, tables_of
from emsid.models.feedback.model import FeedbackModel, FeedbackState
from emsid.models.input_path import InputPath, enter
from emsid.models.linear.system import LinearSystem
from emsid.models.one_channel import segments_longer_than
from emsid.models.refit_data import Budget, Data
from emsid.models.stepping import PlainStepper, Stepper
from emsid.record import Record

Array = NDArray[np.float64]


class FeedbackStepper(Stepper):
    """A linear system with static maps in its feedback."""

    __slots__ = ("_numbers", "_past", "_signals", "_steps", "_tables", "_taps", "_x")

    def __init__(self, model: FeedbackModel, state: FeedbackState, tables: Tables) -> None:
        """
        Args:
            model: what runs.
            state: where it begins.
            tables: of its static maps.
        """
        super().__init__(model, 1, 1)
        path = InputPath(model.delay, model.oversampling, model.held)
        offsets = np.append(model.map_offsets, model.output_offset)
        self._numbers = (read_only(model.matrix), read_only(offsets), read_only(model.factors))
        self._tables, self._taps = tables, path.taps
        self._past, self._x = np.append(0.0, state.inputs), np.array(state.x, dtype=float)
        self._steps = np.empty(path.rate)
        self._signals = LoopSignals.empty(path.rate, model.states, len(model.maps))

    @classmethod
    def of(cls, model: FeedbackModel, state: FeedbackState) -> Stepper:
        """The stepper of a feedback model; a plain one where a map is a function of the user."""
        tables = tables_of(model.maps)
        return PlainStepper(model, state) if tables is None else cls(model, state, tables)

    def _advance(self) -> None:
        take(
            *self._numbers, self._tables, self._taps, self._past, self._steps, self._x, self._signals, self._u, self._y
        )

    @property
    def tables(self) -> Tables:
        """The static maps as numbers."""
        return self._tables

    @property
    def numbers(self) -> tuple[tuple[Array, Array, Array], Array, Array, Array]:
        """Matrix, offsets and factors; taps of the input; past inputs; the linear state."""
        return self._numbers, self._taps, self._past.copy(), self._x.copy()

    @property
    def state(self) -> FeedbackState:
        """The present state."""
        return FeedbackState(self._past[1:].copy(), self._x.copy())


@njit(nogil=True)
def take(
    matrix: Array,
    offsets: Array,
    factors: Array,
    tables: Tables,
    taps: Array,
    past: Array,
    steps: Array,
    x: Array,
    signals: LoopSignals,
    u: Array,
    y: Array,
) -> None:
    """Write the output of one sample into y (1,), and leave the state after it; NaN where it is not finite."""
    enter(taps, past, u[0], steps)
    reached = run(matrix, offsets, factors, tables, steps, x, signals)
    y[0] = signals.y[0] if reached > 0 else np.nan


def c_form(stepper: FeedbackStepper) -> CForm:
    """The form in C of a feedback model, from where its stepper is."""
    (matrix, offsets, factors), taps, past, x = stepper.numbers
    n, m, rate = len(x), len(offsets) - 1, len(taps)

    def row(values: list[float], maps: int, constant: float = 0.0) -> str:
        names = [*(f"s->x[{j}]" for j in range(n)), "steps[k]", *(f"w[{j}]" for j in range(maps))]
        terms = [f"{number(value)} * {name}" for value, name in zip(values, names, strict=False) if value]
        return total([*terms, number(constant)] if constant else terms)

    lines = []
    for i in range(m):
        factor = row(factors[i, : n + 1].tolist(), 0, float(factors[i, n + 1]))
        lines.append(f"        z = {row(matrix[n + i, : n + 1].tolist(), 0, float(offsets[i]))};")
        lines.append(f"        w[{i}] = map_value({i}, z) * ({factor});")
    lines += [f"        after[{j}] = {row(matrix[j].tolist(), m)};" for j in range(n)]
    lines.append("        if (k == 0) {")
    lines.append(f"            y[0] = {row(matrix[n + m].tolist(), m, float(offsets[m]))};")
    lines.append("        }")
    lines += [f"        s->x[{j}] = after[{j}];" for j in range(n)]
    declared = f"    real steps[{rate}];\n    int i;\n    int k;\n"
    if n:
        declared = f"    real after[{n}];\n{declared}"
    if m:
        declared = f"    real w[{m}];\n    real z;\n{declared}"
    step = declared + entering(taps) + f"    for (k = 0; k < {rate}; ++k) {{\n" + "\n".join(lines) + "\n    }\n"
    tables, functions = map_tables(stepper.tables) if m else ((), "")
    define = f"#define PAST {len(past)}\n\n"
    state = (("past", past), ("x", x))
    return CForm(1, 1, state, step, (("taps", taps.ravel()), *tables), f"{define}{SHIFT}\n{functions}")


Complex = NDArray[np.complex128]


class OfFeedbackModels(Capabilities[FeedbackModel]):
    """Linear systems with static maps in their feedback."""

    kind = "feedback"
    model = FeedbackModel
    estimators: ClassVar = {FeedbackModel: fitting.fit_feedback}

    def stepper(self, model: FeedbackModel, state: Any, inputs: int) -> Stepper:
        return FeedbackStepper.of(model, state)

    def c_form(self, stepper: Any, *, single: bool = False, parameters: Sequence[str] = ()) -> CForm:
        return c_form(stepper)

    def linear_part(self, model: FeedbackModel, at: float) -> LinearSystem:
        if model.dt is None:
            raise ModelError(f"{model.name} has no sample time; make it with dt=… in s")
        n, (_, matrix) = model.states, curves.about_rest(model, at)
        parts = matrix[:n, :n], matrix[:n, n:], matrix[n:, :n], matrix[n:, n:]
        return LinearSystem(*parts, model.dt / model.oversampling, model.delay * model.dt, model.name)

    def frequency_response(
        self, model: FeedbackModel, f: Array, dt: float, output: int, input: int, around: float
    ) -> Complex:
        """Near the rest. A held input passes all steps of a sample at once; an interpolated one is a sine at each."""
        check_channel(model, "output", output, 1)
        check_channel(model, "input", input, 1)
        n, steps = model.states, model.oversampling
        whole = curves.about_rest(model, around)[1]
        a, b = whole[:n, :n], whole[:n, n:]
        if model.held:
            powers = [np.linalg.matrix_power(a, k) for k in range(steps)]
            a, b = a @ powers[-1], np.sum(powers, axis=0) @ b
        rate = dt if model.held else dt / steps
        return LinearSystem(a, b, whole[n:, :n], whole[n:, n:], rate, model.delay * dt).response(f)[:, 0, 0]

    def maps_in_use(self, model: FeedbackModel, record: Record) -> tuple[MapInUse, ...]:
        """The maps with their inputs from the states that the first samples of every segment show."""
        seen = curves.visited_in_free_run(model, record).z
        return tuple(MapInUse(z, k, each.value) for k, (z, each) in enumerate(zip(seen.T, model.maps, strict=True), 1))

    def _at_rest(self, model: FeedbackModel, levels: Array) -> Callable[[Any], Array]:
        return curves.feedback_at_rest(model, levels)

    def curves(self, fit: Fit[FeedbackModel], record: Record) -> Iterator[Callable[[], list[BandedCurve]]]:
        yield from super().curves(fit, record)
        yield partial(_maps_in_feedback, fit, record)

    def free_run_error(self, fit: Fit[FeedbackModel], record: Record, transient: int | None) -> Array | None:
        """Its derivatives are exact, and its start takes a search."""
        return curves.feedback_run_error(fit, record, transient)

    def hides_the_sign(self, model: FeedbackModel) -> bool:
        return model.sensor is not None

    def equation(self, fit: Fit[FeedbackModel], record: Record) -> str:
        return curves.rounded_equation(fit, record)

    def section(self, fit: Fit[FeedbackModel]) -> str:
        return "feedback"

    def refitted(self, fit: Fit[FeedbackModel], data: Data, budget: Budget) -> Fit[FeedbackModel]:
        """Among the models that do not run away, as in the search for the structure."""
        from emsid.models.feedback.search import estimation, trials

        if budget is Budget.LAST:
            return estimation.continued(fit, data.records, data.control)
        segments, control = segments_longer_than(fit.model.memory, fit.model, data.records), data.control.quietly()
        refused, out = trials.runs_away, data.by_segment
        found = fitting.searched(
            fit.model, segments, fit.model.edge, budget.steps, 0.1, control, budget.saving, refused=refused,
            left_out=out,
        )  # fmt: skip
        return fit.at(found.model)

    def specification(self, fit: Fit[FeedbackModel]) -> tuple[Any, dict[str, Any]]:
        return fit.model, {}


def _maps_in_feedback(fit: Fit[FeedbackModel], record: Record) -> list[BandedCurve]:
    """The maps over their inputs in the record, in the coordinates of the model."""
    model, found = fit.model, []
    seen = curves.visited_in_free_run(model, record).z
    for k, (z, w) in enumerate(zip(model.numbered("z"), model.names_of_outputs, strict=True)):
        x = np.linspace(float(seen[:, k].min()), float(seen[:, k].max()), POINTS)
        found.append(banded_curve(fit, record, "map in feedback", map_band(fit, record, k, x), (z, ""), (w, "")))
    return found
