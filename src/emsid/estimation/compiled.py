"""Arrays as compiled kernels read them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def read_only(array: NDArray[np.float64]) -> NDArray[np.float64]:
    """The array as kernels read it: contiguous and not to be written to.

    A kernel is compiled anew, which takes seconds, for every memory layout and for writable arrays. With this function
    it is compiled once.
    """
    view = np.ascontiguousarray(array).view()
    view.flags.writeable = False
    return view
