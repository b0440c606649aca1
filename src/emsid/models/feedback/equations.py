"""A feedback model as text, one equation for every signal, and signals of it that are multiples of one another."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.blocks.static_maps import StaticMap

Array = NDArray[np.float64]
Pair = tuple[str, str]
"""Two signals, of which the first is a multiple of the second."""


def shared_signals(name: str, matrix: Array, maps: int, shared: Iterable[Pair]) -> tuple[tuple[Pair, ...], Array]:
    """The pairs, earlier signals first, and M with the elements of the first of each made the closest multiple.

    A force that adds to the input acts as the input does: its column of B_w and D_yw is a multiple of that of u. A
    spring depends on the position that is measured: its row of C_z and D_zu is a multiple of that of the output.

    Args:
        name: of the model.
        matrix: (n + m + 1, n + 1 + m) M.
        maps: m.
        shared: pairs of signals.

    Raises:
        ModelError: for pairs of other signals.
    """
    z, w = numbered("z", maps), numbered("w", maps)
    order = {signal: k for signals in (("y", *z), ("u", *w)) for k, signal in enumerate(signals)}
    pairs = [(str(first), str(second)) for first, second in shared]
    once = len({first for first, _ in pairs}) == len(pairs)
    for first, second in pairs:
        alike = (first in z and second in ("y", *z)) or (first in w and second in ("u", *w))
        if not (once and alike and order[second] < order[first]):
            raise ModelError(
                f"{name}: {first} of {second} is no shared signal; give one pair for a z or w of its {maps} maps, and "
                "y, u or that of an earlier map"
            )
    if pairs:
        matrix = matrix.copy()
        pairs.sort(key=lambda pair: order[pair[0]])
        for of, like in ((entries(matrix, maps, first), entries(matrix, maps, second)) for first, second in pairs):
            matrix[of] = multiple(matrix[of], matrix[like]) * matrix[like]
        matrix.flags.writeable = False
    return tuple(pairs), matrix


def entries(matrix: Array, maps: int, signal: str) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(n + 1,) rows and columns of M: the factors of x and u in a z or in y, or of a w or of u in x⁺ and y."""
    last = len(matrix) - 1
    n = last - maps
    if signal[0] in "zy":
        row = last if signal == "y" else n + numbered("z", maps).index(signal)
        return np.full(n + 1, row), np.arange(n + 1)
    column = n if signal == "u" else n + 1 + numbered("w", maps).index(signal)
    return np.append(np.arange(n), last), np.full(n + 1, column)


def multiple(row: Array, of: Array) -> float:
    """The factor c with which c·``of`` is closest to a row; 0 where that is zero."""
    size = float(of @ of)
    return float(row @ of) / size if size else 0.0


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
