"""Arrays as compiled kernels read them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def read_only(array: NDArray[np.float64]) -> NDArray[np.float64]:
    """The array as kernels read it: contiguous and not to be written to.

    A kernel is compiled once for every layout and for writable arrays besides, which takes seconds; this leaves one of
    them.
    """
    view = np.ascontiguousarray(array).view()
    view.flags.writeable = False
    return view
