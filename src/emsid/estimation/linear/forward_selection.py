r"""Forward orthogonal selection of regressors by their error reduction ratio, on the triangular factor of a regression.

Of all regressors, the next one is that whose part wₖ orthogonal to those already chosen explains most of the target::

    ERRₖ = (wₖᵀy)² / (wₖᵀwₖ · yᵀy)        Σ ERR = 1 − ‖y − Φθ‖²/‖y‖² of the chosen regressors

Columns of R have the same inner products as columns of Φ, since QᵀQ = I. So the whole selection works on the
(n + 1, n + 1) factor of `Information`, whatever the number of samples is, by modified Gram–Schmidt steps.

References:
    Billings, Chen, Korenberg, *Identification of MIMO non-linear systems using a forward-regression orthogonal
    estimator*, International Journal of Control 49 (1989). Billings, *Nonlinear System Identification* (2013), ch. 3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.linear.information import Information

Array = NDArray[np.float64]

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
