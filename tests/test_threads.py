"""Libraries start no threads while searches run in parallel, and may again afterwards."""

import os
from concurrent.futures import ThreadPoolExecutor

import pytest
import scipy.linalg  # noqa: F401
from threadpoolctl import threadpool_info

from emsid.estimation.threads import cores, one_blas_thread, sharing_cores, short_tasks


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
    short_tasks(1).submit(len, ()).result()
    child = os.fork()
    if child == 0:
        try:
            os._exit(short_tasks(1).submit(len, (1, 2, 3)).result(5))
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
