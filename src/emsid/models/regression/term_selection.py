r"""Terms of a structure selected by their error reduction ratio one step ahead, from a dictionary of any size.

This is forward regression by orthogonal least squares (FROLS), see `emsid.estimation.linear.forward_selection`. The
factor R of the dictionary contains all that it needs, but has n² numbers. For a large dictionary the same selection is
made by passes over the data. With the orthonormal direction q of the last chosen term, every pass updates

    ‖wⱼ‖² ← ‖wⱼ‖² − (φⱼᵀq)²        wⱼᵀy ← wⱼᵀy − φⱼᵀq·qᵀy

of every other term j. A column φⱼ exists for a thousand samples at a time; q is computed from the chosen columns and
their own small factor. So memory is that of the chosen columns, whatever the size of the dictionary is.

References:
    Billings, *Nonlinear System Identification* (2013), ch. 3. Chen, Billings, Luo, *Orthogonal least squares methods
    and their application to non-linear system identification*, International Journal of Control 50 (1989).
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.linear.forward_selection import DEPENDENT, forward_selection
from emsid.estimation.linear.information import Information, inverse_triangle
from emsid.estimation.linear.least_squares import check_excitation, gather
from emsid.findings import Finding
from emsid.models.regression.kernels import multiply
from emsid.models.regression.narx import Structure
from emsid.models.regression.regressors import Tables
from emsid.record import Record, check_same_channels

Array = NDArray[np.float64]

# The largest dictionary whose factor is computed; a larger one is passed over once for every chosen term.
FACTORED = 64
# Samples that one thread processes at a time, and samples of one term that stay in the first-level cache.
CHUNK, WIDTH = 1 << 13, 1024


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


def select_terms(dictionary: Structure, records: Record | Iterable[Record], most: int = 10) -> SelectedTerms:
    """The terms of a dictionary that best predict one step ahead, by orthogonal forward selection (FROLS).

    What predicts best one step ahead need not run best freely; `emsid.identify` selects the terms of its polynomial
    NARX model by the free run.

    Args:
        dictionary: for instance ``emsid.polynomial_narx(na=2, nb=2, degree=3)``.
        records: a record, or several experiments.
        most: how many terms to choose; fewer are chosen where all others are combinations of them.

    Raises:
        ModelError, DataError: for records that the dictionary cannot be computed on, or no term to choose.
    """
    if most < 1:
        raise ModelError(f"{dictionary.name}: {most} terms to select; give at least one")
    several = [records] if isinstance(records, Record) else list(records)
    if len(dictionary) <= FACTORED:
        information = gather(dictionary, several)[0]
        found = forward_selection(information, most)
        order, gains = list(found.order), found.error_reduction.tolist()
        findings = about_dictionary(dictionary, information)
    else:
        findings = ()
        order, gains = _by_passes(dictionary, several, most)
    chosen = tuple(dictionary.regressors[k] for k in order)
    names = tuple(dictionary.parameter_names[k] for k in order)
    return SelectedTerms(Structure(chosen, dictionary.name, names, dictionary.inputs), np.array(gains), findings)


def about_dictionary(dictionary: Structure, information: Information) -> tuple[Finding, ...]:
    """A finding where some terms of a dictionary are combinations of others in the data.

    Args:
        dictionary: the terms.
        information: of the records about all of them.
    """
    rank, terms = information.solve().rank, len(dictionary)
    return () if rank == terms else (Finding("dictionary-rank-deficient", "", {"rank": rank, "terms": terms}),)


def _by_passes(dictionary: Structure, records: list[Record], most: int) -> tuple[list[int], list[float]]:
    """Indices of the chosen terms, and their error reduction ratios."""
    for record in records:
        dictionary.check(record)
        check_excitation(record)
        check_same_channels(records[0], record)
    n = len(dictionary)
    parts = [chunk for record in records for chunk in dictionary.chunks(record, CHUNK)]
    windows = [dictionary.window(*part) for part in parts]
    outputs = [y[dictionary.memory :] for y, _ in windows]
    power = float(sum(y @ y for y in outputs))
    products, whole = _correlations(dictionary, windows, outputs, squares=True)
    squares = whole
    order: list[int] = []
    gains: list[float] = []
    left = np.ones(n, dtype=bool)
    while True:
        usable = left & (squares > DEPENDENT * whole)
        if len(order) == most or not usable.any():
            return order, gains
        ratio = np.divide(products**2, squares * (power or 1.0), out=np.full(n, -1.0), where=usable)
        k = int(np.argmax(ratio))
        order.append(k)
        gains.append(float(ratio[k]))
        left[k] = False
        if len(order) < most:
            direction = _last_direction(dictionary, parts, order)
            along = _correlations(dictionary, windows, direction)[0]
            squares = squares - along**2
            products = products - along * float(sum(q @ y for q, y in zip(direction, outputs, strict=True)))


def _last_direction(dictionary: Structure, parts: Sequence[tuple[Record, int, int]], order: list[int]) -> list[Array]:
    """The direction q of the last chosen term, orthogonal to those before it, in every part of the data."""
    chosen = Structure(tuple(dictionary.regressors[k] for k in order), inputs=dictionary.inputs)
    columns = [np.hstack(list(chosen.blocks(*part))) for part in parts]
    factor = Information.empty(len(order))
    for block in columns:
        factor = factor.add_columns(block)
    weights = inverse_triangle(factor.factor[:-1, :-1])[:, -1]
    return [weights @ block[:-1] for block in columns]


def _correlations(
    dictionary: Structure, windows: Sequence[tuple[Array, Array]], targets: Sequence[Array], squares: bool = False
) -> Array:
    """φⱼᵀx of every term with a signal x given in parts, and φⱼᵀφⱼ if wanted; the parts in threads."""

    def of_part(window: tuple[Array, Array], target: Array) -> Array:
        result = np.zeros((2 if squares else 1, len(dictionary)))
        correlate(result, dictionary.tables, *window, dictionary.memory, np.ascontiguousarray(target))
        return result

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        total: Array = np.sum(list(pool.map(of_part, windows, targets)), axis=0)
    return total


@numba.njit(cache=True, nogil=True)
def correlate(result: Array, tables: Tables, y: Array, u: Array, start: int, target: Array) -> None:
    """Add φⱼᵀx and φⱼᵀφⱼ of samples ``start`` … to the rows of a result, tile by tile in the cache.

    Args:
        result: (2, n), or (1, n) without φⱼᵀφⱼ.
        tables: the regressors.
        y, u: (N,) and (nu, N).
        start: the first sample.
        target: (N − start,) x.
    """
    signs, offsets, factors, parameters = tables
    row = np.empty(WIDTH)
    for first in range(start, len(y), WIDTH):
        count = min(WIDTH, len(y) - first)
        part, wanted = row[:count], target[first - start : first - start + count]
        for j in range(len(signs)):
            part[:] = signs[j]
            for f in range(offsets[j], offsets[j + 1]):
                channel, lag, power, code = factors[f]
                signal = y if channel == 0 else u[channel - 1]
                multiply(part, signal[first - lag : first - lag + count], code, parameters[f], power)
            result[0, j] += np.dot(part, wanted)
            if len(result) > 1:
                result[1, j] += np.dot(part, part)
