"""`Identifier`: the identification as an estimator of scikit-learn, for its pipelines and searches.

The rows of X and y are samples of inputs and outputs in the order of time, and ``groups`` tells experiments apart.
``predict`` is the free run from the inputs alone, from rest: nothing of the output is used.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import EmsidError, ModelError
from emsid.identification.workflow import identify
from emsid.models.verbs import simulate
from emsid.options import Options
from emsid.record import Record

try:
    from sklearn.base import BaseEstimator, RegressorMixin
    from sklearn.utils.validation import check_is_fitted, validate_data
except ImportError:
    raise ModelError("emsid.sklearn needs scikit-learn; install it with: pip install 'emsid[sklearn]'") from None

Array = NDArray[np.float64]


class Identifier(RegressorMixin, BaseEstimator):  # type: ignore[misc]  # scikit-learn has no types
    """Identify a system from samples of its inputs and outputs.

    Args:
        models: names of ``emsid list``: one, several with commas, or a list; the best on unseen data is kept.
        dt: the sample time in s.
        unseen: the last part of the samples, on which the models are compared.
        options: given orders, fixed parameters and others, see `emsid.Options`.
    """

    def __init__(
        self,
        models: str | Iterable[str] = "arx",
        *,
        dt: float = 1.0,
        unseen: float = 0.3,
        options: Options | None = None,
    ) -> None:
        self.models = models
        self.dt = dt
        self.unseen = unseen
        self.options = options

    def fit(self, X: ArrayLike, y: ArrayLike, groups: ArrayLike | None = None) -> Self:
        """Identify from inputs X (N, nu) and outputs y (N,) or (N, ny).

        Args:
            X: inputs.
            y: outputs.
            groups: (N,) the experiment of every row; the rows of one stand together, in the order of time.

        Raises:
            ValueError: for data that are no numbers, or from which nothing can be identified, as scikit-learn expects.
        """
        inputs, outputs = validate_data(self, X, y, dtype=np.float64, multi_output=True, y_numeric=True)
        several = outputs.ndim == 2
        labels = np.zeros(len(inputs)) if groups is None else np.asarray(groups)
        if labels.shape != (len(inputs),):
            raise ValueError(f"groups of shape {labels.shape} for {len(inputs)} samples; give one for each")
        edges = np.flatnonzero(labels[1:] != labels[:-1]) + 1
        try:
            record = Record(inputs, outputs, self.dt, breaks=tuple(int(edge) for edge in edges))
            self.identification_ = identify(record, self.unseen, models=self.models, options=self.options)
        except EmsidError as problem:
            raise ValueError(str(problem)) from problem
        self.model_ = self.identification_.recommended
        self.several_outputs_ = several
        return self

    def predict(self, X: ArrayLike) -> Array:
        """The free run (N,) or (N, ny) from inputs X (N, nu), from rest."""
        check_is_fitted(self)
        inputs = validate_data(self, X, dtype=np.float64, reset=False)
        output = simulate(self.model_, Record(inputs, np.zeros((len(inputs), 0)), self.dt)).output
        return output if self.several_outputs_ else output[:, 0]
