"""Libraries start no threads while searches run in parallel, and may again afterwards. Waiting for threads."""

import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from time import sleep

import pytest
import scipy.linalg  # noqa: F401
from threadpoolctl import threadpool_info

from emsid.estimation.threads import cores, in_threads, one_blas_thread, sharing_cores, short_tasks


def blas_threads() -> list[int]:
    return [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]


def test_one_thread_inside_and_the_old_number_afterwards() -> None:
    before = blas_threads()
    with one_blas_thread():
        assert set(blas_threads()) == {1}
        with one_blas_thread():
            assert set(blas_threads()) == {1}
        assert set(blas_threads()) == {1}
    assert blas_threads() == before


@pytest.mark.filterwarnings("ignore:.*multi-threaded.*:DeprecationWarning")  # from Python 3.12 on
@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
def test_a_forked_process_has_its_own_pool_of_short_tasks() -> None:
    assert list(short_tasks(1)(len, [()])) == [0]
    child = os.fork()
    if child == 0:
        try:
            os._exit(next(iter(short_tasks(1)(len, [(1, 2, 3)]))))
        except BaseException:
            os._exit(255)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 3


def test_it_applies_to_threads_started_inside() -> None:
    before = blas_threads()
    with one_blas_thread(), ThreadPoolExecutor(4) as pool:
        assert {number for seen in pool.map(lambda _: blas_threads(), range(40)) for number in seen} == {1}
    assert blas_threads() == before


def test_overlapping_contexts_restore_the_old_number() -> None:
    before = blas_threads()

    @one_blas_thread()
    def inside(number: int) -> int:
        return number

    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(inside, range(40))) == list(range(40))
    assert blas_threads() == before


def test_an_error_restores_it() -> None:
    before = blas_threads()
    with pytest.raises(ZeroDivisionError), one_blas_thread():
        _ = 1 / 0
    assert blas_threads() == before


def test_cores_are_shared_with_other_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 4)
    assert cores() == 4
    with sharing_cores(2):
        assert cores() == 2
        with sharing_cores(8):
            assert cores() == 1
        assert cores() == 2
    assert cores() == 4


INTERRUPTED = """
import hashlib, signal, sys, time
from threading import get_ident
from emsid.estimation.threads import in_threads, short_tasks

pressed, handled = [], []
signal.signal(signal.SIGINT, lambda *_: handled.append(time.monotonic()))


def compute(_):
    time.sleep(0.3)  # by then the main thread waits
    pressed.append(time.monotonic())
    signal.pthread_kill(get_ident(), signal.SIGINT)  # the system may deliver Ctrl-C to any thread
    while time.monotonic() < pressed[0] + 2:
        hashlib.pbkdf2_hmac("sha256", b"", b"", 100_000)  # compiled code, which leaves the interpreter free


if sys.argv[1] == "in_threads":
    with in_threads(2) as in_turn:
        list(in_turn(compute, [0]))
else:
    list(short_tasks(2)(compute, [0]))
print(handled[0] - pressed[0])
"""


@pytest.mark.skipif(not hasattr(signal, "pthread_kill"), reason="this system does not send signals to threads")
@pytest.mark.parametrize("pool", ["in_threads", "short_tasks"])
def test_a_signal_that_another_thread_receives_is_handled_while_the_main_thread_waits(pool: str) -> None:
    seconds = subprocess.run([sys.executable, "-c", INTERRUPTED, pool], check=True, capture_output=True, text=True)
    assert float(seconds.stdout) < 1


def test_results_come_in_the_order_of_the_calls_and_an_error_cancels_the_others() -> None:
    done = []

    def inverse(number: int) -> float:
        sleep(0.002 * number)
        done.append(number)
        return 1 / number

    with in_threads(2) as in_turn:
        assert list(in_turn(inverse, [3, 1, 2])) == [1 / 3, 1, 1 / 2]
        with pytest.raises(ZeroDivisionError):
            list(in_turn(inverse, [0, *range(20, 60)]))
    assert len(done) < 20
