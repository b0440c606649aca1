r"""An input that changes between its rows: what a record then does not determine.

A controller computes a voltage every 100 µs; a log that keeps every tenth row has one of ten. A model that holds the
logged value, or goes straight to the next, is driven by a voltage that did not act. The part of the input that changes
from row to row is then noise of the input (errors in variables): it biases the parameters, and no residual is small
enough to tell. But the mean over some neighbouring rows has less of this noise. So it is a hypothesis about what the
input did between its rows that the means over `ROWS` acted in place of the rows. Where one of them simulates the
outputs better, by more than noise, the rows are not the input that acted. Then the parameters depend on a hypothesis
that nothing confirms:

- one that moves between the hypotheses by more than its standard error, or ends at a bound, is not determined;
- the interval of any other holds what every hypothesis says.

In a record of every value, the means lack what drove the outputs, and their error is many times larger.

`alternatives` does the same for the short times of a plant with a drive.

References:
    Söderström, *Errors-in-Variables Methods in System Identification* (2018), ch. 3, on the bias, and 6, on filtered
    inputs. Diebold, Mariano, *Journal of Business & Economic Statistics* 13 (1995), on paired errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.estimation.nonlinear.control import Stopped
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.findings import Finding
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.free_run_error import FreeRunError
from emsid.models.plants.search import continuation
from emsid.models.plants.search.alternatives import Addition, nothing, spread
from emsid.models.plants.search.between_samples import promises_more
from emsid.models.plants.search.task import Task
from emsid.selection.improvement import StretchErrors, better

Array = NDArray[np.float64]

ROWS = (3, 9)
"""Rows of the means that are tried. Of a drive at 10 kHz with random voltages, logged at 1 kHz, the mean of 3 leaves
0.8 of the squared error and that of 9 leaves 0.6; of 27, as long as its steps, 0.9."""


class Unlogged(NamedTuple):
    """What a record does not determine because its input changes between the rows.

    Attributes:
        names: the parameters that it does not determine.
        addition: to the uncertainty of all parameters, and the finding.
    """

    names: frozenset[str]
    addition: Addition


def unlogged_input(task: Task, problem: FreeRunError, names: Sequence[str], minimum: Minimum) -> Unlogged:
    """Whether the means over some rows of the input simulate the outputs better than the rows.

    Args:
        task: what was asked.
        problem: begun at the minimum.
        names: (p,) the parameters that were estimated.
        minimum: where the search ended.
    """
    plant, p = problem.plant, len(names)
    none = Unlogged(frozenset(), nothing(p))
    if not p or isinstance(plant, DrivenPlant) or plant.of_record(0) is not plant:
        return none
    found: dict[int, Minimum] = {}
    for rows in ROWS:
        end = _by_means(task, problem, rows, minimum, next(iter(found.values()), minimum))
        if end is not None:
            found[rows] = end
    if found and plant.driven_by_means() != plant:  # it may be better because of the plant, and not of the means
        alone = _by_means(task, problem, 1, minimum, found[min(found)])
        found = {rows: end for rows, end in found.items() if alone is None or better(*_errors(task, end, alone))}
    if not found:
        return none
    errors = np.sqrt(np.diag(minimum.covariance)[:p])
    shifts = [(end.estimate - minimum.estimate)[:p] for end in found.values()]
    open_ = np.any(np.abs(shifts) > errors, axis=0) | ~minimum.free[:p]
    least = min(found, key=lambda rows: found[rows].cost)
    unknown = [name for name, moved in zip(names, open_, strict=True) if moved]
    data = {
        "parameters": unknown,
        "inputs": [task.segments[0].input_names[k] for k in plant.acting(task.segments[0].input.shape[1])],
        "rows": least,
        "ratio": float(np.sqrt(minimum.cost / found[least].cost)),
    }
    addition = Addition(spread(shifts, errors), (Finding("input-between-rows-unknown", plant.name, data),))
    return Unlogged(frozenset(unknown), addition)


def _by_means(task: Task, problem: FreeRunError, rows: int, minimum: Minimum, begin: Minimum) -> Minimum | None:
    """The end of a search with the means over some rows of the input; None where it does not simulate better.

    Args:
        task: what was asked.
        problem, minimum: where the search with the input itself ended.
        rows: of the means.
        begin: where to begin, if the means promise more at the minimum.
    """
    other = problem.plant.driven_by_means()
    segments = tuple(replace(each, input=other.means_of(each.input, rows)) for each in task.segments)
    smoothed = replace(task, segments=segments)
    begun = smoothed.problem(other, list(problem.free), problem.states(problem.start))
    try:
        if promises_more(problem, begun, minimum.cost):
            end = continuation.search_once(begun.begun_at(begin.estimate), smoothed)
            return end if better(*_errors(task, end, minimum)) else None
    except (EmsidError, Stopped):
        pass
    return None


def _errors(task: Task, *minima: Minimum) -> list[StretchErrors]:
    """The squared errors of all outputs together, by stretch, at each minimum."""
    channels = len(task.signals)
    squares = ([np.sum(r.reshape(channels, -1) ** 2, axis=0) for r in each.residuals] for each in minima)
    return [StretchErrors.of(np.concatenate(each)) for each in squares]
