"""The data that a model is fitted to again, and how far; see `emsid.models.refitting`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np

from emsid.estimation.fit import Fit
from emsid.estimation.linear.least_squares import least_squares
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.nonlinear.problem import Mask
from emsid.record import Record


class Budget(Enum):
    """How far a model is fitted to other data, from its known estimate; its values are `steps` and `saving`."""

    FEW = (8, 1e-3)
    """A few steps, without intervals: the estimate of the whole data is close to that of a part of them."""
    MINIMUM = (20, 0.0)
    """To the minimum, without intervals, as for pieces that a bootstrap has drawn."""
    LAST = (10, 0.0)
    """As the search for it ends, with intervals and findings."""
    SEARCH = (0, 0.0)
    """The search, for its structure too."""

    @property
    def steps(self) -> int:
        """The most Gauss–Newton steps."""
        return self.value[0]

    @property
    def saving(self) -> float:
        """The search ends once a few steps lower the cost by less than this share."""
        return self.value[1]


@dataclass(frozen=True, eq=False)
class Data:
    """What a model is fitted to again, and how.

    Attributes:
        records: the data, of the same channels and sample time.
        linear: fits a regression one step ahead, from its structure, the records and ``each_block`` (`least_squares`).
        control: when to stop.
        left_out: (N,) of every record, samples that are not fitted; a free run goes on through them. None fits all.
        given: what the user gave for the search, by the names of `emsid.identify`.
        search: searches such a model anew, for `Budget.SEARCH`.
    """

    records: Sequence[Record]
    linear: Callable[..., Fit[Any]] = least_squares
    control: Control = FREE
    left_out: Sequence[Mask] | None = None
    given: Mapping[str, Any] = field(default_factory=dict)
    search: Callable[[Record, Control], Fit[Any]] | None = None

    @property
    def by_segment(self) -> list[Mask] | None:
        """(N,) of every segment, the samples that are not fitted."""
        if self.left_out is None:
            return None
        every = zip(self.left_out, self.records, strict=True)
        return [part for out, record in every for part in np.split(out, record.breaks)]

    @property
    def in_pieces(self) -> list[Record]:
        """The data that are fitted, with a gap where samples are left out."""
        if self.left_out is None:
            return list(self.records)
        return [record.mask(out) for record, out in zip(self.records, self.left_out, strict=True)]
