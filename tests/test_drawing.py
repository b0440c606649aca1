"""Figures drawn by two processes are the same figures."""

from __future__ import annotations

import os
import signal

import numpy as np
import pytest

from emsid.report import drawing
from emsid.report.document import Axis, Figure, Line, Plot
from emsid.report.drawing import Draughtsman, draughtsman
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
def two(monkeypatch: pytest.MonkeyPatch) -> Draughtsman:
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    with draughtsman() as both:
        assert both.beside is not None
        yield both


def test_two_processes_draw_what_one_draws(two: Draughtsman) -> None:
    expected = Draughtsman().finish(figures(6), unheard)
    assert expected == {figure.name: draw(figure) for figure in figures(6)}
    drawn = two.finish(figures(6), unheard)
    assert drawn == expected
    assert list(drawn) == list(expected)


def test_what_has_begun_is_drawn_in_the_meantime_and_once(two: Draughtsman, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = Draughtsman().finish(figures(5), unheard)
    two.begin(figures(2))
    two.begin(figures(3))
    two.wait()
    drawn_here: list[str] = []
    monkeypatch.setattr(two, "beside", None)
    monkeypatch.setattr(drawing, "draw", lambda figure: drawn_here.append(figure.name) or draw(figure))
    assert two.finish(figures(5), unheard) == expected
    assert drawn_here == ["figure-4", "figure-3"]


def test_every_figure_is_drawn_here_where_the_other_process_died(two: Draughtsman) -> None:
    pid = two.beside.submit(os.getpid).result()
    assert pid != os.getpid()
    os.kill(pid, signal.SIGKILL)
    two.begin(figures(1))
    assert list(two.finish(figures(3), unheard)) == ["figure-0", "figure-1", "figure-2"]


def test_an_interrupt_is_left_to_the_parent(two: Draughtsman) -> None:
    pid = two.beside.submit(os.getpid).result()
    os.kill(pid, signal.SIGINT)
    assert two.beside.submit(os.getpid).result() == pid


def test_one_core_draws_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
    with draughtsman() as alone:
        assert alone.beside is None
        told: list[float] = []
        assert len(alone.finish(figures(2), lambda what, fraction: told.append(fraction))) == 2
    assert told == [0.0, 0.5]
