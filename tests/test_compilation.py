"""Ctrl-C while a kernel is compiled: the search ends, and the kernel can be compiled later. Kernels of other laws, and
what is kept on disk of functions that change.
"""

import os
import subprocess
import sys
from itertools import count

import numba
import numpy as np
import pytest

from emsid.compiled import digest_of, with_functions
from emsid.estimation.linear.information import add_rows
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


OWN = {
    "law": """
import numba
import distance

FACTOR = 2.0

@numba.njit(cache=True)
def level(speed, numbers, side):
    return beside(speed) + distance.far(speed)

@numba.njit(cache=True)
def beside(speed):
    return FACTOR * speed
""",
    "distance": """
import numba
from constants import offset

@numba.njit(cache=True)
def far(speed):
    return offset(speed)
""",
    "constants": """
import numba

LEVEL = 10.0

@numba.njit(cache=True)
def offset(speed):
    return LEVEL
""",
    "kernel": """
from emsid.compiled import digest_of, njit
from emsid.plant.friction import of_motion as level

@njit()
def torque(speed, numbers):
    return level(speed, numbers, 0, 0.0, 0.0)
""",
    "plant": """
import numba
import numpy as np
from distance import far

@numba.njit(cache=True)
def derivative(x, u, p):
    return np.array([far(x[0])])

@numba.njit(cache=True)
def output(x, u, p):
    return x.copy()
""",
    "simulated": """
import emsid, kernel, law, plant
import numpy as np
from emsid.compiled import digest_of, with_functions
from emsid.plant.friction import of_forces

own = emsid.OwnPlant(plant.derivative, plant.output, (), (), 1)
end = own.simulate(np.zeros((11, 1)), 0.1, np.zeros(1), ())[-1, 0]
torque = with_functions(kernel.torque, level=of_forces(law.level))
print(torque(3.0, np.zeros((2, 1))), round(end, 9))
""",
}


def test_what_is_kept_of_a_law_and_a_plant_is_not_used_once_a_function_or_constant_that_they_reach_changed(tmp_path):
    for name, text in OWN.items():
        (tmp_path / f"{name}.py").write_text(text)

    def simulated():
        run = [sys.executable, "simulated.py"]
        found = subprocess.run(run, cwd=tmp_path, env=os.environ, capture_output=True, text=True, check=True)
        return [float(each) for each in found.stdout.split()]

    def changed(name, before, after):
        path = tmp_path / f"{name}.py"
        path.write_text(path.read_text().replace(before, after))
        return simulated()

    assert simulated() == [16.0, 10.0]
    assert changed("constants", "LEVEL = 10.0", "LEVEL = 20.0") == [26.0, 20.0]
    assert changed("law", "FACTOR * speed", "FACTOR * FACTOR * speed") == [32.0, 20.0]


def test_a_digest_is_that_of_what_a_function_reaches_and_no_other():
    def made(constant, table, inner):
        def function(x):
            return constant * x + table[0] + inner(x)

        return function

    def same(x):
        return x

    def other(x):
        return 2 * x

    arguments = (2.0, np.arange(3.0), same)
    changes = [(3.0, *arguments[1:]), (2.0, np.arange(1.0, 4.0), same), (2.0, np.arange(3.0), numba.njit(other))]
    digests = {digest_of(made(*each)) for each in (arguments, *changes)}
    assert digest_of(made(*arguments)) == digest_of(made(2.0, np.arange(3.0), same))
    assert len(digests) == 1 + len(changes)
    assert digest_of(numba.njit(same)) != digest_of(numba.njit(fastmath=True)(same))
    program = "from emsid.compiled import digest_of; from emsid.estimation.linear.information import add_rows as f"
    run = [sys.executable, "-c", f"{program}; print(digest_of(f))"]
    found = [
        subprocess.run(run, env={**os.environ, "PYTHONHASHSEED": seed}, capture_output=True, text=True).stdout
        for seed in "12"
    ]
    assert found[0] == found[1] == f"{digest_of(add_rows)}\n"
