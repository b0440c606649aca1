"""Figures drawn by two processes are the same figures."""

from __future__ import annotations

import os
import signal
from concurrent.futures import Executor

import numpy as np
import pytest

from emsid.report.content import Axis, Figure, Line, Plot
from emsid.report.drawing import draw_all, drawing_process
from emsid.report.figures import draw


def figures(count: int) -> list[Figure]:
    t = np.linspace(0, 1, 50)
    return [
        Figure(f"figure-{k}", "A sine.", (Plot((Line(t, np.sin(k * t)),), Axis("Time", "s"), Axis("y", "V")),))
        for k in range(count)
    ]


def unheard(what: str, fraction: float) -> None:
    pass


@pytest.fixture
def beside(monkeypatch: pytest.MonkeyPatch) -> Executor:
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    with drawing_process() as pool:
        assert pool is not None
        yield pool


def test_two_processes_draw_what_one_draws(beside: Executor) -> None:
    expected = {figure.name: draw(figure) for figure in figures(6)}
    drawn = draw_all(figures(6), beside, unheard)
    assert drawn == expected
    assert list(drawn) == list(expected)


def test_every_figure_is_drawn_here_where_the_other_process_died(beside: Executor) -> None:
    pid = beside.submit(os.getpid).result()
    assert pid != os.getpid()
    os.kill(pid, signal.SIGKILL)
    assert list(draw_all(figures(3), beside, unheard)) == ["figure-0", "figure-1", "figure-2"]


def test_an_interrupt_is_left_to_the_parent(beside: Executor) -> None:
    pid = beside.submit(os.getpid).result()
    os.kill(pid, signal.SIGINT)
    assert beside.submit(os.getpid).result() == pid


def test_one_core_draws_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
    with drawing_process() as pool:
        assert pool is None
    told: list[float] = []
    assert len(draw_all(figures(2), None, lambda what, fraction: told.append(fraction))) == 2
    assert told == [0.0, 0.5]
