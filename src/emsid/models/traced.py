"""Numbers that keep how they are computed from parameters, so that this computation can be written in C.

A plant whose parameters are `Traced` computes the numbers of its kernel as ever; each then has the expression in C that
gives it, and a function that computes it at other values. A branch is that of the present values, and a function that
is not defined here gives a plain number: whether the expressions hold at other values is for the caller to check.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Any

from emsid.models.c_form import number

Compute = Callable[[Sequence[float]], float]


class Traced:
    """A number and the expression of it.

    Arithmetic gives others; comparisons are those of the number. Checks of types take it for a ``float``.

    Attributes:
        value: the number.
        text: in C, of the parameters ``p[0]``, ``p[1]`` …
        at: computes it from other values of the parameters.
    """

    __slots__ = ("at", "text", "value")
    __class__ = property(lambda _: float)

    def __init__(self, value: float, text: str, at: Compute) -> None:
        self.value, self.text, self.at = value, text, at

    @classmethod
    def parameter(cls, k: int, value: float) -> Traced:
        """The parameter k."""
        return cls(value, f"p[{k}]", lambda p: p[k])

    def __float__(self) -> float:
        return self.value

    def __int__(self) -> int:
        return int(self.value)

    def __bool__(self) -> bool:
        return self.value != 0

    def __repr__(self) -> str:
        return self.text

    def __hash__(self) -> int:
        return hash(self.text)

    def __neg__(self) -> Any:
        return Traced(-self.value, f"(-{self.text})", lambda p: -self.at(p))

    def __abs__(self) -> Any:
        return -self if self.value < 0 else self

    def __pow__(self, power: Any) -> Any:
        return _combined("*", operator.mul, self, self) if power == 2 else NotImplemented


def text_of(value: Any) -> str:
    """A number in C."""
    return value.text if type(value) is Traced else number(float(value))


def at(values: Sequence[Any], parameters: Sequence[float]) -> list[float]:
    """Numbers, `Traced` or not, at other values of the parameters."""
    return [each.at(parameters) if type(each) is Traced else float(each) for each in values]


def put(thing: Any, path: Sequence[str | int], value: Any) -> Any:
    """A nested value with another one at a path, whose parts are not checked anew."""
    if not path:
        return value
    step, rest = path[0], path[1:]
    if isinstance(thing, tuple):
        found = tuple(put(each, rest, value) if k == step else each for k, each in enumerate(thing))
        return type(thing)(*found) if hasattr(thing, "_fields") else found
    made = object.__new__(type(thing))
    for field in fields(thing):
        each = getattr(thing, field.name)
        object.__setattr__(made, field.name, put(each, rest, value) if field.name == step else each)
    return made


def _combined(sign: str, compute: Callable[[float, float], float], left: Any, right: Any) -> Any:
    """A number and another, at least one of them `Traced`, by an operation with this sign in C."""
    if not (isinstance(left, int | float) and isinstance(right, int | float)):
        return NotImplemented  # an array takes it element by element
    if sign in "*/" and not _is_traced(right) and right == 1:
        return left
    if sign == "*" and not _is_traced(left) and left == 1:
        return right
    text = f"({text_of(left)} {sign} {text_of(right)})"
    return Traced(compute(float(left), float(right)), text, lambda p: compute(*at((left, right), p)))


def _is_traced(value: Any) -> bool:
    return type(value) is Traced


def _operator(sign: str, compute: Callable[[float, float], float], turned: bool = False) -> Callable[[Any, Any], Any]:
    """The method of an operation, or that of its second operand."""
    return lambda a, b: _combined(sign, compute, *((b, a) if turned else (a, b)))


for _sign, _compute in (("+", operator.add), ("-", operator.sub), ("*", operator.mul), ("/", operator.truediv)):
    setattr(Traced, f"__{_compute.__name__}__", _operator(_sign, _compute))
    setattr(Traced, f"__r{_compute.__name__}__", _operator(_sign, _compute, turned=True))
for _compare in (operator.lt, operator.le, operator.gt, operator.ge, operator.eq, operator.ne):
    setattr(Traced, f"__{_compare.__name__}__", lambda a, b, compare=_compare: compare(a.value, float(b)))
for _function in (math.sqrt, math.exp, math.expm1, math.sin, math.cos):  # NumPy's look for a method
    setattr(
        Traced,
        _function.__name__,
        lambda x, of=_function: Traced(of(x.value), f"{of.__name__.upper()}({x.text})", lambda p: of(x.at(p))),
    )
