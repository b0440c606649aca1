"""Batch least squares (paper, eqs. 3.6–3.10) by orthogonal triangularisation.

A structure computes its regression [Φ y] in blocks. All blocks update one `Information` (constant memory, any number of
records, several threads), which is solved once at the end. The estimate can be refined to the last digits (Björck,
*Numerical Methods for Least Squares Problems*, sec. 2.9): the gradient Φᵀ(y − Φθ) is accumulated in double-double
precision, including the rounding errors of the products in Φ, and the existing factor gives the correction,
``RᵀR δ = Φᵀ(y − Φθ)``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import repeat
from math import isfinite
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.compiled import njit
from emsid.errors import DataError, ModelError
from emsid.estimation.fit import Ending, Fit
from emsid.estimation.linear.information import Information, Solution
from emsid.estimation.threads import cores, in_threads
from emsid.findings import Finding
from emsid.record import Record, check_same_channels

Array = NDArray[np.float64]
M_co = TypeVar("M_co", covariant=True)

# Samples that one thread processes at a time. The chunks, and so the results, do not depend on the number of threads.
CHUNK = 1 << 17
# The largest value of a channel, and the inverse of the smallest peak; powers of others would over- or underflow.
SETTLED = 0.1
"""An output has settled whose range in the last quarter is less than this share of its whole range."""
LARGEST = 1e60
SAMPLES_PER_PARAMETER = 3
"""With fewer samples than this for a parameter, an estimate follows the noise of the record."""


class LinearStructure(Protocol[M_co]):
    """What least squares needs of a structure that is linear in its parameters."""

    @property
    def name(self) -> str: ...
    @property
    def parameter_names(self) -> tuple[str, ...]: ...
    @property
    def labels(self) -> tuple[str, ...]:
        """Every regressor as text."""
        ...

    @property
    def memory(self) -> int:
        """The largest lag in samples."""
        ...

    def check(self, record: Record) -> None:
        """Refuse a record that it cannot be fitted to."""
        ...

    def chunks(self, record: Record, size: int) -> Sequence[tuple[Record, int, int]]:
        """The rows of the regression, in pieces (segment, start, stop) of at most ``size``."""
        ...

    def blocks(self, segment: Record, start: int, stop: int) -> Iterator[Array]:
        """[Φ y] of these rows as blocks of columns (n + 1, m)."""
        ...

    def rounding(self, segment: Record, start: int, stop: int) -> Iterator[Array]:
        """The rounding errors of Φ in these blocks, (n, m) each."""
        ...

    def add_rows(self, factor: Array, segment: Record, start: int, stop: int) -> None:
        """Update a triangular factor (n + 1, n + 1) in place with [Φ y] of these rows, without the GIL."""
        ...

    def model(self, parameters: Array, record: Record) -> M_co:
        """The model with these parameters, for records like this one."""
        ...


def least_squares(
    structure: LinearStructure[M_co],
    records: Record | Iterable[Record],
    *,
    ridge: float = 0.0,
    refinements: int = 0,
    rank_tolerance: float | None = None,
    threads: int | None = None,
    each_block: Callable[[], object] | None = None,
) -> Fit[M_co]:
    """The parameters that minimise the one-step prediction error over one or several records (3.10).

    Args:
        structure: what to fit, for instance ``emsid.arx(na=4, nb=4)``.
        records: a record, or several experiments; a generator is read once, one record in memory at a time.
        ridge: weight ρ ≥ 0 of ρ‖θ‖² added to the sum of squares.
        refinements: passes over the data that correct the rounding of the estimate; each costs about as much as the
            fit itself. Needs records that can be read again.
        rank_tolerance: see `Information.solve`.
        threads: number of threads, by default one per core; the result does not depend on it.
        each_block: is called before each block of the file that a record is an excerpt of, all rows of which are taken;
            None takes the excerpt alone.

    Returns:
        A fit. Where the data do not determine every parameter, its ``ending`` is `Ending.RANK_DEFICIENT`, a finding
        names the regressors that are combinations of others, and their parameters are zero.

    Raises:
        ModelError, DataError: for records that the structure cannot be fitted to.
    """
    if not (isfinite(ridge) and ridge >= 0):
        raise ModelError(f"a ridge of {ridge}; give a finite weight that is not negative")
    if refinements and not isinstance(records, Record):
        records = list(records)
    information, first = gather(structure, records, threads, each_block)
    if ridge:
        information = information.with_prior(ridge)
    solution = information.solve(rank_tolerance)
    estimate = solution.estimate
    if refinements and solution.rank == information.parameters:
        estimate = _refined(information, estimate, partial(_all_blocks, structure, records), refinements, ridge)
    return solved(structure, information, solution, first, estimate)


def solved(
    structure: LinearStructure[M_co], information: Information, solution: Solution, record: Record, estimate: Array
) -> Fit[M_co]:
    """The fit of a structure.

    Args:
        structure: what was fitted.
        information: of all data.
        solution: of it.
        record: one like those that were fitted.
        estimate: (n,) that of the solution, or a refined one.
    """
    return Fit(
        model=structure.model(estimate, record),
        names=structure.parameter_names,
        estimate=estimate,
        covariance=solution.covariance,
        noise_variance=solution.noise_variance,
        samples=information.samples,
        condition=solution.condition,
        rank=solution.rank,
        ending=Ending.SOLVED if solution.rank == information.parameters else Ending.RANK_DEFICIENT,
        findings=tuple(rank_findings(solution, structure.labels) + sample_findings(information)),
    )


def solve_rows(regression: ArrayLike, target: ArrayLike, refinements: int = 4) -> Solution:
    """Least squares on a given matrix, refined to the last digits of double precision.

    Args:
        regression: Φ, (N, n).
        target: y, (N,).
        refinements: the largest number of corrections; they stop when they no longer shrink.
    """
    information = Information.from_rows(regression, target)
    solution = information.solve()
    if solution.rank < information.parameters:
        return solution
    columns = np.vstack([np.asarray(regression, dtype=float).T, np.asarray(target, dtype=float)])
    blocks = [(columns, np.zeros_like(columns))]  # the rounding errors of the given rows are unknown
    return replace(solution, estimate=_refined(information, solution.estimate, lambda: blocks, refinements))


def gather(
    structure: LinearStructure[object],
    records: Record | Iterable[Record],
    threads: int | None = None,
    each_block: Callable[[], object] | None = None,
) -> tuple[Information, Record]:
    """The information of the records about the parameters of a structure, and the first record; see `least_squares`.

    Raises:
        DataError: without a record, for one that `check_excitation` refuses, channels that differ, fewer samples than
            parameters, regressors that overflow.
    """
    first: Record | None = None
    information = Information.empty(len(structure.parameter_names))
    with in_threads(threads or cores()) as parallel:
        for record in (records,) if isinstance(records, Record) else records:
            structure.check(record)
            check_excitation(record)
            first = first or record
            check_same_channels(first, record)
            for part in (record,) if each_block is None else record.blocks(structure.memory):
                if each_block is not None:
                    each_block()
                information = with_record(information, structure, part, parallel)
    if first is None:
        raise DataError("no record to identify from")
    check_information(information, structure, first.name)
    return information, first


def with_record(
    information: Information,
    structure: LinearStructure[object],
    record: Record,
    parallel: Callable[..., Iterable[Information]] = map,
) -> Information:
    """The information with that of one more record.

    Args:
        information: so far.
        structure: what is fitted.
        record: the data; of a part of a record it may be short, or constant.
        parallel: as `map`, for a record of several chunks; a short one is faster without threads.
    """
    chunks = structure.chunks(record, CHUNK)
    for part in (map if len(chunks) == 1 else parallel)(_chunk_information, repeat(structure), chunks):
        information = information.merge(part)
    return information


def check_information(information: Information, structure: LinearStructure[object], name: str) -> None:
    """Refuse the information of data that are too few for a structure, or whose regressors overflow.

    Raises:
        DataError: with the name of the data.
    """
    if information.samples < information.parameters:
        raise DataError(
            f"{name}: {information.samples:g} usable samples for the {information.parameters} parameters of "
            f"{structure.name}; record longer or choose a smaller structure"
        )
    if not np.isfinite(information.factor).all():
        raise DataError(f"{name}: the regressors of {structure.name} overflow; scale the channels or lower powers")


def rank_findings(solution: Solution, labels: Sequence[str]) -> list[Finding]:
    """The regressors that are zero or combinations of others in these data."""
    if not solution.aliases:
        return []
    zero = [labels[first] for first, *others in solution.aliases if not others]
    alike = [
        {"regressor": labels[first], "like": [labels[k] for k in others]}
        for first, *others in solution.aliases
        if others
    ]
    data = {"rank": solution.rank, "parameters": len(labels), "zero": zero, "alike": alike}
    return [Finding("rank-deficient", data=data)]


def sample_findings(information: Information) -> list[Finding]:
    """A finding if there are few samples for each parameter."""
    if information.samples >= SAMPLES_PER_PARAMETER * information.parameters:
        return []
    return [Finding("few-samples", data={"samples": information.samples, "parameters": information.parameters})]


def settles(record: Record) -> bool:
    """Whether an output moves from its first value to another one and stays there, as after a step of the input.

    In a record without the middle of a response, only all segments together show that.
    """
    for piece in (record, *record.segments):
        moves, rests = np.ptp(piece.output, axis=0), np.ptp(piece.output[-len(piece) // 4 :], axis=0)
        if np.any((np.abs(piece.output[-1] - piece.output[0]) > moves / 2) & (rests < SETTLED * moves)):
            return True
    return False


def check_excitation(record: Record) -> None:
    """Refuse records that cannot be used: a channel that is constant, or whose powers would overflow.

    A constant input that is not zero is used where the output still settles: it is a step before the first sample.

    Raises:
        DataError: naming the channel.
    """
    for names, values, kind in (
        (record.input_names, record.input, "input"),
        (record.output_names, record.output, "output"),
    ):
        for k, name in enumerate(names):
            x = values[:, k]
            if np.ptp(x[:1000]) == 0 and np.ptp(x) == 0 and not (kind == "input" and x[0] and settles(record)):
                raise DataError(
                    f"{record.name}: {kind} {name!r} is constant at {x[0]:g}, so nothing can be identified from it; "
                    "record while it changes, or name another column"
                )
            _check_size(record, kind, name, x)


def check_sizes(record: Record) -> None:
    """Refuse channels whose squares are no numbers; a channel of zeros is none of them.

    Raises:
        DataError: naming the channel.
    """
    for kind, names, values in (
        ("input", record.input_names, record.input),
        ("output", record.output_names, record.output),
    ):
        for name, x in zip(names, values.T, strict=True):
            if x.any():
                _check_size(record, kind, name, x)


def _check_size(record: Record, kind: str, name: str, x: Array) -> None:
    largest = float(max(x.max(), -x.min()))
    if not 1 / LARGEST < largest < LARGEST:
        raise DataError(
            f"{record.name}: {kind} {name!r} reaches {largest:.3g}, which cannot be computed with; scale it to an "
            "ordinary size",
            arguments=("scale",),
        )


def _chunk_information(structure: LinearStructure[object], chunk: tuple[Record, int, int]) -> Information:
    segment, start, stop = chunk
    size = len(structure.parameter_names) + 1
    factor = np.zeros((size, size))
    structure.add_rows(factor, segment, start, stop)
    return Information(factor, stop - start)


def _all_blocks(
    structure: LinearStructure[object], records: Record | Iterable[Record]
) -> Iterator[tuple[Array, Array]]:
    for record in (records,) if isinstance(records, Record) else records:
        for chunk in structure.chunks(record, CHUNK):
            yield from zip(structure.blocks(*chunk), structure.rounding(*chunk), strict=True)


def _refined(
    information: Information,
    estimate: Array,
    blocks: Callable[[], Iterable[tuple[Array, Array]]],
    passes: int,
    ridge: float = 0.0,
) -> Array:
    """θ after at most this many corrections δ with RᵀR δ = Φᵀ(y − Φθ) − ρθ, the columns of R scaled to unit length.

    Between the passes θ is the sum of two doubles. With one double, its rounding would give a large gradient along
    well-determined directions, and the correction would disturb the others. The passes stop when the corrections no
    longer shrink; that last correction is not applied.
    """
    from scipy.linalg import solve_triangular

    n = information.parameters
    triangle = information.factor[:n, :n]
    length = np.linalg.norm(triangle, axis=0)
    unit = triangle / length
    smallest, rest = np.inf, np.zeros(n)
    for _ in range(passes):
        gradient = np.zeros((2, n))
        for block, lost in blocks():
            accumulate_gradient(gradient, block, lost, estimate, rest)
        half = solve_triangular(unit, (gradient[0] - ridge * estimate) / length, trans="T")
        correction = solve_triangular(unit, half)
        size = float(np.linalg.norm(correction))
        if not size < smallest / 2:
            break
        rest = rest + correction / length
        estimate, before = estimate + rest, estimate
        rest, smallest = rest - (estimate - before), size
    return estimate


@njit(nogil=True)
def accumulate_gradient(gradient: Array, block: Array, lost: Array, estimate: Array, rest: Array) -> None:
    """Add Φᵀ(y − Φθ) of a block of columns [Φ y] to a gradient (2, n); it, Φ and θ are sums of two doubles.

    Products and sums are exact to twice the working precision (Dekker's and Knuth's error-free transformations).
    """
    parameters, rows = len(estimate), block.shape[1]
    for i in range(rows):
        high, low = block[parameters, i], 0.0
        for j in range(parameters):
            product, error = two_product(-block[j, i], estimate[j])
            high, carry = _two_sum(high, product)
            low += carry + error - block[j, i] * rest[j] - lost[j, i] * estimate[j]
        high, low = _two_sum(high, low)
        for j in range(parameters):
            product, error = two_product(block[j, i], high)
            error += block[j, i] * low + lost[j, i] * high
            gradient[0, j], carry = _two_sum(gradient[0, j], product)
            gradient[1, j] += carry + error
    for j in range(parameters):
        gradient[0, j], gradient[1, j] = _two_sum(gradient[0, j], gradient[1, j])


@njit(nogil=True, inline="always")
def _two_sum(a: float, b: float) -> tuple[float, float]:
    """a + b as its rounding and the error of that."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


@njit(nogil=True, inline="always")
def two_product(a: float, b: float) -> tuple[float, float]:
    """a·b as its rounding and the error of that, the factors split into halves of 26 bits."""
    product = a * b
    wide = 134217729.0 * a
    a_high = wide - (wide - a)
    a_low = a - a_high
    wide = 134217729.0 * b
    b_high = wide - (wide - b)
    b_low = b - b_high
    return product, ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low
