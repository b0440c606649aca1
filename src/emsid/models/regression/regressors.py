"""Regressors as data: products of powers of lagged channels.

A channel is an output, an input, or a static transform of one. A regressor can be written as text and read back. The
kernels use it as rows of tables.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.regression.transforms import Transform, has_parameter, has_scale, read_transform, written

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

# The largest power, computed by multiplication.
HIGHEST_POWER = 99


@dataclass(frozen=True, order=True)
class Factor:
    """A power of a lagged channel, with an optional transform.

    Attributes:
        channel: 0 for the output y, k for the k-th input.
        lag: in samples, at least 1 for the output.
        power: exponent, at least 1.
        transform: applied to the channel first.
        parameter: of the transform, in the unit of the channel.
    """

    channel: int
    lag: int
    power: int = 1
    transform: Transform = Transform.VALUE
    parameter: float = 0.0

    def __post_init__(self) -> None:
        if self.lag < (1 if self.channel == 0 else 0):
            raise ModelError(f"lag {self.lag} of {'y' if self.channel == 0 else 'u'}: a model cannot look ahead")
        if not 1 <= self.power <= HIGHEST_POWER:
            raise ModelError(f"power {self.power}: powers are whole numbers from 1 to {HIGHEST_POWER}")
        if not isfinite(self.parameter):
            raise ModelError(f"{self.transform.name.lower()} with {self.parameter}: give a finite number")
        if has_scale(self.transform) and not self.parameter > 0:
            raise ModelError(f"{self.transform.name.lower()} over {self.parameter}: its scale must be positive")
        if not has_parameter(self.transform) and self.parameter:
            raise ModelError(f"{self.transform.name.lower()} with {self.parameter}: it has no parameter; leave it zero")

    def __str__(self) -> str:
        letter = "y" if self.channel == 0 else "u" if self.channel == 1 else f"u{self.channel}"
        x = f"{letter}(t-{self.lag})" if self.lag else f"{letter}(t)"
        text = written(self.transform, x, self.parameter)
        return text if self.power == 1 else f"{text}^{self.power}"


@dataclass(frozen=True)
class Regressor:
    """A product of lagged channels.

    Args:
        factors: the factors; without any, the regressor is the constant 1.
        negative: whether it has a minus sign.
    """

    factors: tuple[Factor, ...] = ()
    negative: bool = False

    @property
    def is_linear(self) -> bool:
        """Whether it is a past signal itself, without a transform, power or product."""
        return len(self.factors) == 1 and self.factors[0] == Factor(self.factors[0].channel, self.factors[0].lag)

    def __str__(self) -> str:
        product = "*".join(str(factor) for factor in self.factors) or "1"
        return f"-{product}" if self.negative else product


def parse_regressor(text: str) -> Regressor:
    """Parse a regressor; see `Structure.parse`.

    Raises:
        ModelError: for a text that is not a regressor.
    """
    excerpt = text if len(text) <= 80 else f"{text[:80]}…"
    try:
        tree = ast.parse(text.strip().replace("^", "**"), mode="eval").body
        products = list(_products(tree, 1))
    except SyntaxError as problem:
        raise ModelError(f"regressor {excerpt!r} is not understood: {problem.msg}") from None
    except (ValueError, RecursionError, MemoryError):  # a null byte, or too deeply nested
        raise ModelError(f"regressor {excerpt!r} is not understood") from None
    negative = False
    factors: dict[Factor, int] = {}
    for node, power in products:
        match node:
            case ast.Constant(1):
                pass
            case ast.USub():
                negative ^= power % 2 == 1
            case _:
                factor = _factor(node, excerpt)
                factors[factor] = factors.get(factor, 0) + power
    return Regressor(
        tuple(Factor(f.channel, f.lag, power, f.transform, f.parameter) for f, power in factors.items()),
        negative,
    )


def _products(node: ast.expr, power: int) -> Iterator[tuple[ast.AST, int]]:
    """The factors of a product, including minus signs, with their powers."""
    match node:
        case ast.UnaryOp(ast.USub() as minus, operand):
            yield minus, power
            yield from _products(operand, power)
        case ast.BinOp(left, ast.Mult(), right):
            yield from _products(left, power)
            yield from _products(right, power)
        case ast.BinOp(base, ast.Pow(), ast.Constant(int(exponent))) if exponent >= 1:
            yield from _products(base, power * exponent)
        case _:
            yield node, power


def _factor(node: ast.AST, text: str) -> Factor:
    """One lagged channel, with an optional transform."""

    transform, inner, parameter = read_transform(node)
    match inner:
        case ast.Call(ast.Name(letter), [ast.Name("t")], []):
            lag = 0
        case ast.Call(ast.Name(letter), [ast.BinOp(ast.Name("t"), ast.Sub(), ast.Constant(int(lag)))], []):
            pass
        case _:
            raise ModelError(
                f"regressor {text!r}: {ast.unparse(inner)!r} is not a lagged channel such as y(t-1) or u(t-2)"
            )
    number = letter[1:] or "1"
    if letter != "y" and not (letter[:1] == "u" and number.isdigit() and int(number) > 0):
        raise ModelError(f"regressor {text!r}: no channel {letter!r}; there are y, u, u2, u3, …")
    return Factor(0 if letter == "y" else int(number), lag, 1, transform, parameter)


class Tables(NamedTuple):
    """A structure in the form that the kernels use.

    Attributes:
        signs: (p,) of every regressor.
        offsets: (p + 1,); the factors ``offsets[j]`` to ``offsets[j + 1]`` belong to regressor j.
        factors: (f, 4) channel, lag, power and transform of every factor.
        parameters: (f,) of the transforms.
    """

    signs: Array
    offsets: Integers
    factors: Integers  # (f, 4): channel, lag, power, transform
    parameters: Array  # (f,)


def tables(regressors: Sequence[Regressor]) -> Tables:
    """Regressors in the form that the kernels use."""
    factors = [f for r in regressors for f in r.factors]
    return Tables(
        signs=np.array([-1.0 if r.negative else 1.0 for r in regressors]),
        offsets=np.cumsum([0] + [len(r.factors) for r in regressors]).astype(np.int64),
        factors=np.array([(f.channel, f.lag, f.power, int(f.transform)) for f in factors], dtype=np.int64).reshape(
            -1, 4
        ),
        parameters=np.array([f.parameter for f in factors], dtype=float),
    )
