"""The data that a structure is fitted to again, and how far; see `emsid.models.refitting`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from emsid.estimation.fit import Fit
from emsid.estimation.nonlinear.control import Control
from emsid.estimation.nonlinear.without_samples import Mask
from emsid.record import Record

STEPS = 8
"""Steps from the estimate of the whole data to that of a part of them."""
SAVING = 1e-3
"""The search ends once a few steps lower the cost by less than this share."""
REPEATED_STEPS = 20
"""Steps of a fit to pieces that a bootstrap has drawn, which begins at the estimate and has to reach the minimum."""

Linear = Callable[[Any, Sequence[Record]], Fit[Any]]
"""How a regression is fitted one step ahead, from its structure and the records."""


@dataclass(frozen=True, eq=False)
class Data:
    """What a model is fitted to again, and how.

    Attributes:
        records: the data.
        linear: fits a regression one step ahead.
        control: when to stop.
        left_out: (N,) of every record, the samples that are not fitted; None fits all.
    """

    records: Sequence[Record]
    linear: Linear
    control: Control
    left_out: Sequence[Mask] | None

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
