"""Columns that the tests of the first look describe, and what was found of them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy import signal

import emsid
from emsid.cli.commands.describe import proposals as commands
from emsid.first_look import groups

N = 800
_rng = np.random.default_rng(1)
U = np.repeat(_rng.integers(-10, 11, N // 10).astype(float), 10)
Y = signal.lfilter([0.0, 0.5], [1.0, -0.9], U) + 0.01 * _rng.standard_normal(N)
T = 0.01 * np.arange(N)
Write = Callable[..., Path]
Run = Callable[..., tuple[int, str, str]]


def codes(look: emsid.FirstLook) -> set[str]:
    """The codes of its findings."""
    return {finding.code for finding in look.findings}


def data(look: emsid.FirstLook, code: str) -> dict[str, object]:
    """The data of its one finding with this code."""
    (found,) = (finding for finding in look.findings if finding.code == code)
    return dict(found.data)


def proposals(looks: list[emsid.FirstLook]) -> list[list[str]]:
    """The words of the commands that are proposed for these files."""
    return commands(groups(looks))


def table(separator: str, times: np.ndarray, header: str = "") -> str:
    """The text of a file with the columns time, U and Y."""
    rows = (f"{t:.14g}{separator}{u:g}{separator}{y:.5f}" for t, u, y in zip(times, U, Y, strict=True))
    return header + "\n".join(rows) + "\n"
