"""Static transforms of a channel: their notation and their values.

A transform of a channel x has at most one parameter p. To add one, add a member of `Transform` and its branches in
`transformed` and `slope`, all in this file. Printing, parsing, files and kernels use these three.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable
from enum import IntEnum
from functools import cache
from typing import Any

import numpy as np

from emsid.compiled import njit

Definition = Callable[[Any, float], Any]


class Transform(IntEnum):
    """Static transforms of a channel x, with one parameter p.

    The value is the code in the kernels. ``text`` is the notation: a divisor p must be positive, and "x-p" can have
    either sign, or no p. ``definition`` is the function of x and p, as a slow and simple reference; x may be an array.
    """

    text: str
    definition: Definition

    def __new__(cls, code: int, text: str, definition: Definition) -> Transform:
        member = int.__new__(cls, code)
        member._value_, member.text, member.definition = code, text, definition
        return member

    VALUE = 0, "x", lambda x, p: x
    SIGN = 1, "sign(x)", lambda x, p: np.sign(x)  # eq. (4.8)
    TANH = 2, "tanh(x/p)", lambda x, p: np.tanh(x / p)  # a sign that is smooth over p
    ABOVE = 3, "max(x-p, 0)", lambda x, p: np.maximum(x - p, 0.0)  # the right branch of a dead zone (4.9)
    BELOW = 4, "min(x-p, 0)", lambda x, p: np.minimum(x - p, 0.0)  # its left branch
    ABS = 5, "abs(x)", lambda x, p: abs(x)
    DECAY = 6, "exp(-abs(x)/p)", lambda x, p: np.exp(-abs(x) / p)  # the Stribeck term of (4.7)


@njit(nogil=True, inline="always")
def transformed(code: int, x: float, p: float) -> float:
    """A static transform of one value, by its code in `Transform`."""
    if code == 0:
        return x
    if code == 1:
        return float(np.sign(x))
    if code == 2:
        return float(np.tanh(x / p))
    if code == 3:
        return max(x - p, 0.0)
    if code == 4:
        return min(x - p, 0.0)
    if code == 5:
        return abs(x)
    return float(np.exp(-abs(x) / p))


@njit(nogil=True, inline="always")
def slope(code: int, x: float, p: float) -> float:
    """The derivative of a static transform with respect to x; at a kink, of the side where it is zero or smaller."""
    if code == 0:
        return 1.0
    if code == 1:
        return 0.0
    if code == 2:
        return float((1.0 - np.tanh(x / p) ** 2) / p)
    if code == 3:
        return 1.0 if x > p else 0.0
    if code == 4:
        return 1.0 if x < p else 0.0
    if code == 5:
        return float(np.sign(x))
    return float(-np.sign(x) * np.exp(-abs(x) / p) / p)


@cache
def has_parameter(transform: Transform) -> bool:
    """Whether it has a parameter p."""
    return re.search(r"\bp\b", transform.text) is not None


@cache
def has_scale(transform: Transform) -> bool:
    """Whether p is a divisor, which must be positive."""
    return re.search(r"/p\b", transform.text) is not None


def written(transform: Transform, x: str, parameter: float) -> str:
    """The transform of a channel as text, with every digit of its parameter."""
    number = f"{float(parameter)}".removesuffix(".0")
    shift = f"{-float(parameter):+}".removesuffix(".0") if parameter else ""
    texts = {"x": x, "-p": shift, "p": number}
    return re.sub(r"\bx\b|-p\b|\bp\b", lambda found: texts[found[0]], transform.text)


def read_transform(node: ast.AST) -> tuple[Transform, ast.AST, float]:
    """The transform, its argument and its parameter; another expression is `Transform.VALUE`."""
    for transform, pattern in _patterns().items():
        found: dict[str, ast.AST | float] = {}
        if _matches(pattern, node, found) and isinstance(inner := found["x"], ast.AST):
            parameter = found.get("p", 0.0)
            return transform, inner, parameter if isinstance(parameter, float) else 0.0
    return Transform.VALUE, node, 0.0


@cache
def _patterns() -> dict[Transform, ast.expr]:
    return {each: ast.parse(each.text, mode="eval").body for each in Transform if each is not Transform.VALUE}


def _matches(pattern: ast.AST, node: ast.AST, found: dict[str, ast.AST | float]) -> bool:
    """Whether an expression matches a pattern; its x and p are put into ``found``."""
    match pattern, node:
        case ast.Name("x"), _:
            found["x"] = node
            return True
        case ast.Name("p"), ast.Constant(int() | float() as number):
            found["p"] = float(number)
            return True
        case ast.BinOp(left, ast.Sub(), ast.Name("p")), _:
            match node:
                case ast.BinOp(inner, ast.Sub() | ast.Add() as sign, ast.Constant(int() | float() as number)):
                    found["p"] = float(number) if isinstance(sign, ast.Sub) else -float(number)
                    return _matches(left, inner, found)
            return _matches(left, node, found)
        case ast.BinOp(left, one, right), ast.BinOp(other_left, other, other_right) if type(one) is type(other):
            return _matches(left, other_left, found) and _matches(right, other_right, found)
        case ast.UnaryOp(one, operand), ast.UnaryOp(other, other_operand) if type(one) is type(other):
            return _matches(operand, other_operand, found)
        case ast.Call(ast.Name(name), arguments), ast.Call(ast.Name(other_name), others, []):
            same = name == other_name and len(arguments) == len(others)
            return same and all(_matches(*pair, found) for pair in zip(arguments, others, strict=True))
        case ast.Constant(value), ast.Constant(other_value):
            return bool(value == other_value)
    return False
