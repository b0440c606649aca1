"""A fork calls a function while this process does something else: the answer and the errors are the same."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from functools import partial
from time import sleep

import numpy as np
import pytest

import emsid
from emsid.cli.fork import forked, has_free_core, meanwhile

pytestmark = [
    pytest.mark.skipif(not has_free_core(), reason="this system has no second process"),
    pytest.mark.filterwarnings("ignore:.*multi-threaded.*:DeprecationWarning"),  # from Python 3.12 on
]
HERE = os.getpid()


def test_a_fork_answers() -> None:
    assert meanwhile(os.getpid, alone=True)() != HERE
    assert meanwhile(os.getpid, alone=False)() == HERE


def test_an_error_of_the_user_comes_from_the_fork_with_its_arguments() -> None:
    def refused():
        raise emsid.DataError(f"no column in {os.getpid()}", arguments=("input",))

    with pytest.raises(emsid.DataError, match="no column") as raised:
        meanwhile(refused, alone=True)()
    assert raised.value.arguments == ("input",)
    assert str(HERE) not in str(raised.value)


@pytest.mark.parametrize("ends", [partial(os._exit, 0), partial(int, "no number"), lambda: lambda: 1])
def test_what_a_fork_does_not_answer_is_found_here(ends) -> None:
    def unless_here():
        return HERE if os.getpid() == HERE else ends()

    assert meanwhile(unless_here, alone=True)() == HERE


def test_waiting_for_a_fork_can_be_ended() -> None:
    receiving, sending = os.pipe()  # the fork reads, and nothing is written

    class Enough(Exception):
        pass

    def stop():
        raise Enough

    with pytest.raises(Enough):
        meanwhile(partial(os.read, receiving, 1), alone=True)(stop)
    os.close(sending)
    os.close(receiving)


def test_a_fork_ends_with_the_first_process() -> None:
    process, connection = forked(lambda send: sleep(60))
    connection.close()  # as the system does where a process ends in any way
    process.join(5)
    assert process.exitcode == 0


def test_a_record_from_another_process_is_read_only() -> None:
    record = pickle.loads(pickle.dumps(emsid.Record(np.arange(5.0), np.ones(5), 0.1)))
    for array in (record.input, record.output):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


def test_reading_imports_no_compiler() -> None:
    """The fork that reads does so within the time of the imports of the first process."""
    code = "import sys, emsid.io, emsid.first_look.clock; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
