"""Ctrl-C while a kernel is compiled: the search ends, and the kernel can be compiled later. Kernels of other laws."""

from itertools import count

import numba
import pytest

from emsid.compiled import with_functions
from emsid.estimation.nonlinear.compilation import cancelled_with
from emsid.estimation.nonlinear.control import Control, Stopped
from emsid.plant.friction import of_motion


@pytest.fixture
def kernel():
    @numba.njit
    def inner(x):
        return x + 1.0

    @numba.njit
    def outer(x):
        return 2.0 * inner(x)

    return outer


@pytest.mark.parametrize("passes", [0, 3, 25, 40], ids="before pass {}".format)
def test_a_cancelled_search_does_not_complete_a_kernel_which_can_be_compiled_afterwards(kernel, passes):
    heard = count()
    with cancelled_with(Control(cancelled=lambda: next(heard) >= passes)), pytest.raises(Stopped):
        kernel(1.0)
    assert next(heard) == passes + 1
    assert not kernel.signatures
    assert kernel(1.0) == 4.0


def test_a_kernel_is_completed_where_the_time_is_up_and_a_compiled_one_always_runs(kernel):
    with cancelled_with(Control(deadline=0.0)):
        assert kernel(1.0) == 4.0
    with cancelled_with(Control(cancelled=lambda: True)):
        assert kernel(3.0) == 8.0


def test_a_law_that_changes_is_compiled_again_although_its_name_stays():
    def small():
        def level(*_):
            return 1.0

        return level

    def large():
        def level(*_):
            return 2.0

        return level

    names = [with_functions(of_motion, coulomb_stribeck=law).__name__ for law in (small(), small(), large())]
    assert names[0] == names[1] != names[2]
