r"""Terms of a structure selected by their error reduction ratio one step ahead, from a dictionary of any size.

This is forward regression by orthogonal least squares (FROLS), without the matrix Φ of the dictionary or its factor.
With the orthonormal direction q of the last chosen term, one pass over the data updates

    ‖wⱼ‖² ← ‖wⱼ‖² − (φⱼᵀq)²        wⱼᵀy ← wⱼᵀy − φⱼᵀq·qᵀy

of every other term j; `correlate` computes φⱼᵀq. These differences lose digits. So the part w of the term that
seems best is computed itself before the term is chosen: orthogonal to all directions so far by one Gram–Schmidt step,
and by a second one where the first cancels digits. If its exact ratio falls behind that of another term, that one is
tried.

A dictionary of at most `SMALL` terms is selected from its factor R, if the products ΦᵀΦ give it: R = chol(ΦᵀΦ) has a
relative error of about ε/λ, where ε is that of a number and λ the smallest eigenvalue of the products of columns of
unit length. Where λ is below `EIGENVALUE`, the passes over the data select.

Memory: the chosen columns and a copy of the signals, (most + 4)·N numbers, and 40 numbers for every term of the
dictionary, instead of the n·N of its matrix or the n² of its factor.

**Selection on the factor.** Of all regressors, the next one is that whose part wₖ orthogonal to those already chosen
explains most of the target::

    ERRₖ = (wₖᵀy)² / (wₖᵀwₖ · yᵀy)        Σ ERR = 1 − ‖y − Φθ‖²/‖y‖² of the chosen regressors

Columns of R have the same inner products as columns of Φ, since QᵀQ = I. So the whole selection works on the
(n + 1, n + 1) factor of `Information`, whatever the number of samples is, by modified Gram–Schmidt steps.

**Inner products.** Regressors of a dictionary share factors: ``y(t-1)*y(t-2)*u(t-1)`` and ``y(t-1)*y(t-2)*u(t-2)``
differ in the last one. So a dictionary is a tree. A node is a product of factors; its parent is the product without the
last factor. Then ``φⱼᵀx = Σₜ x(t)·(product of all factors but the last)·(last factor)``, and for a few hundred samples
at a time every node is computed once, from its parent, for all regressors below it. For n lagged signals and degree 3,
n³/6 regressors take n³/6 multiplications and additions per sample, and memory for n + 4 rows of a few hundred numbers.

References:
    Billings, *Nonlinear System Identification* (2013), ch. 3. Chen, Billings, Luo, *Orthogonal least squares methods
    and their application to non-linear system identification*, International Journal of Control 50 (1989). Daniel,
    Gragg, Kaufman, Stewart, *Reorthogonalization and stable algorithms for updating the Gram–Schmidt QR factorization*,
    Mathematics of Computation 30 (1976). Higham, *Accuracy and Stability of Numerical Algorithms* (2002), ch. 20, on
    normal equations.
    Billings, Chen, Korenberg, *Identification of MIMO non-linear systems using a forward-regression orthogonal
    estimator*, International Journal of Control 49 (1989).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.errors import DataError, ModelError
from emsid.estimation.linear.information import Information
from emsid.estimation.linear.least_squares import check_excitation, gather
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.threads import cores, one_blas_thread, short_tasks
from emsid.findings import Finding
from emsid.models.regression.kernels import fill, multiply
from emsid.models.regression.narx import Structure
from emsid.models.regression.regressors import Integers, Regressor, tables
from emsid.record import Record, check_same_channels

Array = NDArray[np.float64]

# A part that has less than this fraction of its column's square is made orthogonal once more.
CANCELLED = 1e-2
# The largest dictionary whose products are computed, and whose rank is looked at.
SMALL = 64
# The smallest eigenvalue of these products with which the factor has nine digits.
EIGENVALUE = 1e-6
# Samples for each of its terms that the rank is looked at in first.
RANK_SAMPLES = 10
# Samples whose products are computed at a time; those of a small dictionary stay in the second-level cache.
WIDTH = 1 << 10
# Samples that one thread processes at a time.
CHUNK = 1 << 15


@dataclass(frozen=True, eq=False)
class SelectedTerms:
    """Terms in the order in which they were chosen.

    Attributes:
        structure: the chosen terms.
        error_reduction: (k,) the fraction of Σy² that each of them adds to what is predicted one step ahead.
        findings: facts about the dictionary; `emsid.wording` makes sentences of them.
    """

    structure: Structure
    error_reduction: Array
    findings: tuple[Finding, ...] = ()


def select_terms(
    dictionary: Structure, records: Record | Iterable[Record], most: int = 10, control: Control = FREE
) -> SelectedTerms:
    """The terms of a dictionary that best predict one step ahead, by orthogonal forward selection (FROLS).

    What predicts best one step ahead need not run best freely; `emsid.identify` selects the terms of its polynomial
    NARX model by the free run. The matrix of the dictionary is never made: the memory beyond the data is that of the
    chosen columns, and some 40 numbers for every term.

    Args:
        dictionary: for instance ``emsid.polynomial_narx(na=2, nb=2, degree=3)``.
        records: a record, or several experiments.
        most: how many terms to choose; fewer are chosen where all others are combinations of them.
        control: when to stop, and where to report progress.

    Raises:
        ModelError, DataError: for records that the dictionary cannot be computed on, or no term to choose.
        Stopped: if the control ends the selection.
    """
    if most < 1:
        raise ModelError(f"{dictionary.name}: {most} terms to select; give at least one")
    most = min(most, len(dictionary))
    data = _Signals(dictionary, [records] if isinstance(records, Record) else list(records), most)
    with one_blas_thread():
        known = data.information()
        if known is not None:
            control.doing(f"selecting terms of {len(dictionary):,}", 0, most)
            found = forward_selection(known, most)
            return _selected(dictionary, found.order, found.error_reduction)
        selection = _Selection(data, most)
        while selection.add_best() and len(selection.order) < most:
            control.doing(f"selecting terms of {len(dictionary):,}", len(selection.order), most)
            selection.update()
    return _selected(dictionary, selection.order, np.array(selection.gains), data.findings())


def _selected(
    dictionary: Structure, order: Sequence[int], gains: Array, findings: tuple[Finding, ...] = ()
) -> SelectedTerms:
    chosen = tuple(dictionary.regressors[k] for k in order)
    names = tuple(dictionary.parameter_names[k] for k in order)
    return SelectedTerms(Structure(chosen, dictionary.name, names, dictionary.inputs), gains, findings)


def about_dictionary(dictionary: Structure, information: Information) -> tuple[Finding, ...]:
    """A finding where some terms of a dictionary are combinations of others in the data.

    Args:
        dictionary: the terms.
        information: of the records about all of them.
    """
    rank, terms = information.solve().rank, len(dictionary)
    return () if rank == terms else (Finding("dictionary-rank-deficient", "", {"rank": rank, "terms": terms}),)


class _Signals:
    """The samples of some records, and the inner products of the terms of a dictionary with signals over them."""

    def __init__(self, dictionary: Structure, records: Sequence[Record], most: int) -> None:
        for record in records:
            dictionary.check(record)
            check_excitation(record)
            check_same_channels(records[0], record)
        self.dictionary, self.records = dictionary, records
        self.memory = dictionary.memory
        self.parts = [chunk for record in records for chunk in dictionary.chunks(record, CHUNK)]
        self.windows = [dictionary.window(*part) for part in self.parts]
        ends = np.cumsum([0] + [stop - start for _, start, stop in self.parts])
        self.slices = [slice(*pair) for pair in pairwise(ends.tolist())]
        self.output = np.concatenate([y[self.memory :] for y, _ in self.windows] or [np.empty(0)])
        if len(self.output) < most:
            raise DataError(
                f"{dictionary.name}: {len(self.output)} usable samples for {most} terms; record longer, or select fewer"
            )

    @cached_property
    def tree(self) -> Tree:
        """The products that the terms share."""
        return tree(self.dictionary.regressors)

    def information(self) -> Information | None:
        """By the products of all columns; None where the dictionary is large, or too many digits cancel."""
        n = len(self.dictionary)
        if n > SMALL:
            return None
        products, block = np.zeros((n + 1, n + 1)), np.empty((n + 1, WIDTH))
        with np.errstate(over="ignore", invalid="ignore"):
            for (y, u), part in zip(self.windows, self.slices, strict=True):
                for first in range(0, part.stop - part.start, WIDTH):
                    seen = block[:, : min(WIDTH, part.stop - part.start - first)]
                    fill(seen, self.dictionary.tables, y, u, self.memory + first, seen.shape[1])
                    products += seen @ seen.T
        length = np.sqrt(np.diag(products)[:n])
        if not (np.isfinite(products).all() and length.all()):
            return None
        unit = products[:n, :n] / np.outer(length, length)
        if np.linalg.eigvalsh(unit)[0] < EIGENVALUE:
            return None
        lower = np.linalg.cholesky(unit)
        along = np.linalg.solve(lower, products[:n, n] / length)
        rest = np.sqrt(max(products[n, n] - along @ along, 0.0))
        factor = np.block([[lower.T * length, along[:, None]], [np.zeros((1, n)), rest]])
        return Information(factor, float(len(self.output)))

    def correlations(self, signal: Array, square: bool = False) -> Array:
        """(n,) φⱼᵀx of every term with a signal x (N,), or Σ x·φⱼ²; the parts in threads."""

        def of_part(window: tuple[Array, Array], part: slice) -> Array:
            result = np.zeros(len(self.dictionary))
            correlate(result, self.tree, *window, self.memory, signal[part], square)
            return result

        several = len(self.windows) > 1 and len(self.dictionary) > SMALL
        in_turn = short_tasks(cores()) if several else map
        total: Array = np.sum(list(in_turn(of_part, self.windows, self.slices)), axis=0)
        return total

    def column(self, term: int) -> Array:
        """(N,) φⱼ of one term."""
        one = tables((self.dictionary.regressors[term],))
        block = np.empty((2, CHUNK))
        column = np.empty(len(self.output))
        for window, part in zip(self.windows, self.slices, strict=True):
            count = part.stop - part.start
            fill(block, one, *window, self.memory, count)
            column[part] = block[0, :count]
        return column

    def findings(self) -> tuple[Finding, ...]:
        """What `about_dictionary` finds, if the dictionary is small; a few samples are enough to show its full rank."""
        size = len(self.dictionary)
        if size > SMALL or size > len(self.output):
            return ()
        segment, start, stop = self.parts[0]
        few = Information.empty(size)
        self.dictionary.add_rows(few.factor, segment, start, min(stop, start + RANK_SAMPLES * size))
        return about_dictionary(self.dictionary, few) and about_dictionary(
            self.dictionary, gather(self.dictionary, self.records)[0]
        )


class _Selection:
    """Terms chosen so far, and of every other one its part orthogonal to them.

    Attributes:
        order: the chosen terms.
        gains: their error reduction ratios.
        directions: (k, N) their orthonormal directions q.
        along: (k, n) φⱼᵀq of every term.
        squares, products, whole: (n,) ‖wⱼ‖², wⱼᵀy and ‖φⱼ‖².
    """

    def __init__(self, data: _Signals, most: int) -> None:
        self.data = data
        self.power = float(data.output @ data.output) or 1.0
        self.whole = data.correlations(np.ones(len(data.output)), square=True)
        if not np.isfinite(self.whole).all():
            raise DataError(f"the terms of {data.dictionary.name} overflow; scale the channels or lower powers")
        self.squares, self.products = self.whole.copy(), data.correlations(data.output)
        self.left = np.ones(len(self.whole), dtype=bool)
        self._directions, self._along = np.empty((most, len(data.output))), np.empty((most, len(self.whole)))
        self.order: list[int] = []
        self.gains: list[float] = []

    @property
    def directions(self) -> Array:
        return self._directions[: len(self.order)]

    @property
    def along(self) -> Array:
        return self._along[: len(self.order)]

    def add_best(self) -> bool:
        """Choose the term that reduces the error most; False where all that are left depend on those chosen."""
        tried, direction = -1, np.empty(0)
        while True:
            self.left &= self.squares > DEPENDENT * self.whole
            ratio = np.divide(self.products**2, self.squares, out=np.full(len(self.left), -1.0), where=self.left)
            best = int(np.argmax(ratio))
            if not self.left[best]:
                return False
            if best == tried:
                break
            part = self.orthogonal_part(best)
            self.squares[best], self.products[best] = part @ part, part @ self.data.output
            tried, direction = best, part
        self._directions[len(self.order)] = direction / np.sqrt(self.squares[best])
        self.order.append(best)
        self.gains.append(float(ratio[best] / self.power))
        self.left[best] = False
        return True

    def orthogonal_part(self, term: int) -> Array:
        """(N,) the part of a term that is orthogonal to all directions, to rounding."""
        part = self.data.column(term)
        part -= self.along[:, term] @ self.directions
        if part @ part < CANCELLED * self.whole[term]:
            part -= (self.directions @ part) @ self.directions
        return part

    def update(self) -> None:
        """Take the direction of the last chosen term out of all others."""
        direction, along = self.directions[-1], self.along[-1]
        along[:] = self.data.correlations(direction)
        self.squares -= along**2
        self.products -= along * float(direction @ self.data.output)


# --- selection on the factor ------------------------------------------------------------------------------------------

# A column depends on the chosen ones if less than this fraction of its square is orthogonal to them.
DEPENDENT = 1e-12


@dataclass(frozen=True, eq=False)
class Selection:
    """Regressors in the order in which they were chosen.

    Attributes:
        order: indices of the chosen columns.
        error_reduction: (k,) the fraction of yᵀy that each of them adds to what is explained.
    """

    order: tuple[int, ...]
    error_reduction: Array


def forward_selection(information: Information, most: int, first: Sequence[int] = ()) -> Selection:
    """Choose up to ``most`` regressors, each the one that reduces the squared error most.

    Args:
        information: of all regressors.
        most: the largest number of chosen regressors.
        first: columns that are chosen before all others, in this order.

    Returns:
        The chosen columns; fewer than ``most`` where all others are combinations of them.
    """
    n = information.parameters
    columns, target = information.factor[:, :n].copy(), information.factor[:, n].copy()
    whole = np.einsum("ij,ij->j", columns, columns)
    total = float(target @ target)
    order: list[int] = []
    gains: list[float] = []
    left = np.ones(n, dtype=bool)
    while len(order) < min(most, n):
        squares = np.einsum("ij,ij->j", columns, columns)
        usable = left & (squares > DEPENDENT * whole)
        ratio = np.divide((columns.T @ target) ** 2, squares * (total or 1.0), out=np.full(n, -1.0), where=usable)
        k = first[len(order)] if len(order) < len(first) else int(np.argmax(ratio))
        if not usable[k]:
            if len(order) < len(first):
                raise ValueError(f"column {k} depends on the columns before it")
            break
        direction = columns[:, k] / np.sqrt(squares[k])
        columns -= np.outer(direction, direction @ columns)
        target -= direction * (direction @ target)
        left[k] = False
        order.append(k)
        gains.append(float(ratio[k]))
    return Selection(tuple(order), np.array(gains))


# Samples of one factor that are processed at a time: those of a node and of four factors stay in the first-level cache.
SAMPLES = 512
# Regressors of one node whose sums are computed together.
TOGETHER = 4
# The channel of the factor 1, which a constant regressor consists of.
ONE = -1


class Tree(NamedTuple):
    """The regressors of a dictionary as a tree of products, in the form that the kernel uses.

    Attributes:
        factors: (f, 3) channel, lag and transform of the different factors; channel `ONE` is the constant 1.
        parameters: (f,) of their transforms.
        nodes: (m, 2) depth in the tree and last factor of every product; a node follows its parent, and between them
            there are only others below that parent. The first node is the empty product.
        offsets: (m + 1,); the ends ``offsets[k]`` to ``offsets[k + 1]`` belong to node k.
        ends: (n, 2) regressor and last factor.
        signs: (n,) of the regressors.
    """

    factors: Integers
    parameters: Array
    nodes: Integers
    offsets: Integers
    ends: Integers
    signs: Array


def tree(regressors: Sequence[Regressor]) -> Tree:
    """The tree of these regressors; a power counts as equal factors."""
    factors: dict[tuple[float, ...], int] = {}
    products: dict[tuple[int, ...], list[tuple[int, int]]] = {(): []}
    for j, regressor in enumerate(regressors):
        codes = [
            factors.setdefault((f.channel, f.lag, f.transform, f.parameter), len(factors))
            for f in regressor.factors
            for _ in range(f.power)
        ] or [factors.setdefault((ONE, 0, 0, 0.0), len(factors))]
        *path, last = codes
        products.setdefault(tuple(path), []).append((j, last))
    for path_of in list(products):
        for length in range(1, len(path_of)):
            products.setdefault(path_of[:length], [])
    nodes = sorted(products)
    several = np.array(list(factors), dtype=float).reshape(-1, 4)
    return Tree(
        factors=several[:, :3].astype(np.int64),
        parameters=np.ascontiguousarray(several[:, 3]),
        nodes=np.array([(len(node), node[-1] if node else 0) for node in nodes], dtype=np.int64),
        offsets=np.cumsum([0] + [len(products[node]) for node in nodes]).astype(np.int64),
        ends=np.array([end for node in nodes for end in products[node]], dtype=np.int64).reshape(-1, 2),
        signs=np.array([-1.0 if r.negative else 1.0 for r in regressors]),
    )


@njit(nogil=True)
def correlate(result: Array, products: Tree, y: Array, u: Array, start: int, weight: Array, square: bool) -> None:
    """Add φⱼᵀx of samples ``start`` … to a result, or the sum of x·φⱼ².

    Args:
        result: (n,).
        products: the regressors.
        y, u: (N,) and (nu, N).
        start: the first sample.
        weight: (N − start,) x.
        square: whether to sum squares.
    """
    factors, parameters, nodes, offsets, ends, signs = products
    rows = np.empty((len(factors), SAMPLES))
    path = np.empty((nodes[:, 0].max() + 1, SAMPLES))
    sums = np.zeros(len(ends))
    for first in range(start, len(y), SAMPLES):
        count = min(SAMPLES, len(y) - first)
        for f in range(len(factors)):
            row = rows[f, :count]
            row[:] = 1.0
            channel, lag, code = factors[f]
            if channel != ONE:
                signal = y if channel == 0 else u[channel - 1]
                multiply(row, signal[first - lag : first - lag + count], code, parameters[f], 2 if square else 1)
        path[0, :count] = weight[first - start : first - start + count]
        for k in range(len(nodes)):
            depth = nodes[k, 0]
            if depth > 0:
                _multiplied(path[depth], path[depth - 1], rows[nodes[k, 1]], count)
            _add_sums(sums, path[depth], rows, ends, offsets[k], offsets[k + 1], count)
    for k in range(len(ends)):
        j = ends[k, 0]
        result[j] += sums[k] if square else signs[j] * sums[k]


_vectorised = njit(nogil=True, fastmath={"reassoc", "contract", "nsz"}, error_model="numpy")


@_vectorised
def _multiplied(out: Array, a: Array, b: Array, count: int) -> None:
    """out = a·b in the first elements."""
    for i in range(count):
        out[i] = a[i] * b[i]


@_vectorised
def _add_sums(sums: Array, node: Array, rows: Array, ends: Integers, begin: int, end: int, count: int) -> None:
    """Add Σ node·row to the sum of every end ``begin`` … ``end``, four at a time."""
    k = begin
    while k + TOGETHER <= end:
        a, b, c, d = rows[ends[k, 1]], rows[ends[k + 1, 1]], rows[ends[k + 2, 1]], rows[ends[k + 3, 1]]
        of_a, of_b, of_c, of_d = 0.0, 0.0, 0.0, 0.0
        for i in range(count):
            x = node[i]
            of_a += x * a[i]
            of_b += x * b[i]
            of_c += x * c[i]
            of_d += x * d[i]
        sums[k] += of_a
        sums[k + 1] += of_b
        sums[k + 2] += of_c
        sums[k + 3] += of_d
        k += TOGETHER
    while k < end:
        a = rows[ends[k, 1]]
        of_a = 0.0
        for i in range(count):
            of_a += node[i] * a[i]
        sums[k] += of_a
        k += 1
