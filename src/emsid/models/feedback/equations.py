"""A feedback model as text: one equation for every signal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from emsid.models.blocks.static_maps import StaticMap

Array = NDArray[np.float64]

# Digits of a coefficient: poles close to one another need more than a gain does.
DIGITS = 10


def equations(
    matrix: Array, factors: Array, offsets: Array, maps: Sequence[StaticMap], entering: str = "", step: str = "1"
) -> str:
    """One line for every signal, in the order in which a step computes them: z, g, w, y, then the next state.

    >>> from emsid.models.blocks.static_maps import Saturation
    >>> matrix = np.array([[0.9, 0.1, -0.2], [1, 0, 0], [1, 0, 0]])
    >>> print(equations(matrix, np.array([[0, 1.0, 0]]), np.zeros(2), (Saturation(),)))
    z(t) = x1(t)
    g(t) = u(t)
    w(t) = (min(max(1*z(t), -1), 1))*g(t)
    y(t) = x1(t) + e(t)
    x1(t+1) = 0.9*x1(t) + 0.1*u(t) - 0.2*w(t)

    Args:
        matrix: (n + m + 1, n + 1 + m) M.
        factors: (m, n + 2) F; a constant row is that of a map that is not multiplied.
        offsets: (m + 1,) added to every z, and to y.
        maps: m static maps.
        entering: the equation of the input v that enters; none where u does.
        step: of the state, in samples.
    """
    m = len(maps)
    n = len(matrix) - m - 1
    z, w, g = (numbered(letter, m) for letter in "zwg")
    columns = [*(f"x{k + 1}(t)" for k in range(n)), "v(t)" if entering else "u(t)", *(f"{each}(t)" for each in w)]
    lines = [entering] if entering else []
    for i, each in enumerate(maps):
        lines.append(f"{z[i]}(t) = {_sum(matrix[n + i], columns, offsets[i])}")
        curve = each.expression(f"{z[i]}(t)")
        if factors[i, :-1].any():
            lines.append(f"{g[i]}(t) = {_sum(factors[i, :-1], columns[: n + 1], factors[i, -1])}")
            curve = f"({curve})*{g[i]}(t)"
        lines.append(f"{w[i]}(t) = {curve}")
    lines.append(f"y(t) = {_sum(matrix[n + m], columns, offsets[m])} + e(t)")
    lines += [f"x{k + 1}(t+{step}) = {_sum(matrix[k], columns, 0.0)}" for k in range(n)]
    return "\n".join(lines)


def numbered(letter: str, count: int) -> tuple[str, ...]:
    """z for one map; z1, z2, … for several."""
    return (letter,) if count == 1 else tuple(f"{letter}{k + 1}" for k in range(count))


def _sum(factors: Array, names: list[str], offset: float) -> str:
    """A sum of products, without zeros and without factors of one."""
    text = ""
    for value, name in zip([*factors, offset], [*names, ""], strict=True):
        if value:
            size = f"{abs(value):.{DIGITS}g}"
            term = f"{size}*{name}" if name and size != "1" else name or size
            text += f" {'-' if value < 0 else '+'} {term}"
    if not text:
        return "0"
    return text[3:] if text[1] == "+" else f"-{text[3:]}"
