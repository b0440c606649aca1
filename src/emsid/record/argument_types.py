"""Types of arguments: a value of another type is refused in words, before it reaches a computation.

A kind is a test and the words for what passes it. Ranges are checked where the argument is used, except that a number
must be one that a float can hold.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import wraps
from inspect import signature
from numbers import Integral, Real
from typing import Any, NamedTuple, TypeVar

import numpy as np

from emsid.errors import DataError

Method = TypeVar("Method", bound=Callable[..., Any])


LONGEST = 2_000
"""The longest text in characters, for names and conditions."""


class Kind(NamedTuple):
    """A kind of argument.

    Attributes:
        fits: whether a value is of this kind.
        words: what to give, for messages.
    """

    fits: Callable[[Any], bool]
    words: str


def _is_number(value: object) -> bool:
    if isinstance(value, bool | np.bool_) or not isinstance(value, Real):
        return False
    try:
        float(value)
    except OverflowError:  # an integer of hundreds of digits
        return False
    return True


def _is_whole(value: object) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool | np.bool_) and abs(int(value)) < 2**63


def _is_slice(value: object) -> bool:
    return isinstance(value, slice) and all(
        each is None or _is_whole(each) for each in (value.start, value.stop, value.step)
    )


def _is_text(value: object) -> bool:
    return isinstance(value, str) and len(value) <= LONGEST


def _is_names(value: object) -> bool:
    several = isinstance(value, Sequence) and not isinstance(value, str | bytes)
    return all(map(_is_text, value)) if several and isinstance(value, Sequence) else _is_text(value)


def _by_name(fits: Callable[[Any], bool]) -> Callable[[Any], bool]:
    def all_fit(value: object) -> bool:
        return isinstance(value, Mapping) and all(isinstance(key, str) and fits(each) for key, each in value.items())

    return all_fit


def _all(fits: Callable[[Any], bool]) -> Callable[[Any], bool]:
    def all_fit(value: object) -> bool:
        return isinstance(value, Sequence) and not isinstance(value, str | bytes) and all(map(fits, value))

    return all_fit


def _is_pair(value: object) -> bool:
    return isinstance(value, Sequence) and len(value) == 2 and all(map(_is_number, value))


def items_of(kind: type) -> Kind:
    """A list of values of a class, of which some may be None."""
    return Kind(_all(lambda each: each is None or isinstance(each, kind)), f"a list of values of {kind.__name__}")


NUMBER = Kind(_is_number, "a number that a float can hold")
WHOLE = Kind(_is_whole, "a whole number")
TEXT = Kind(_is_text, f"a text of at most {LONGEST:,} characters")
CONDITION = Kind(lambda value: isinstance(value, str), "a text")
NAME = Kind(lambda value: _is_text(value) and bool(value), "a name")
NAMES = Kind(_is_names, "a name, or a list of names")
SWITCH = Kind(lambda value: isinstance(value, bool | np.bool_), "True or False")
SLICE = Kind(_is_slice, "a slice of whole numbers, as in slice(100, 2000)")
NUMBERS = Kind(_by_name(_is_number), "a dictionary from names to numbers")
TEXT_LIST = Kind(_is_names, "a text for each of them")
WHOLE_LIST = Kind(_all(_is_whole), "a list of whole numbers")
NUMBER_LIST = Kind(_all(_is_number), "a list of numbers")
PAIRS = Kind(_by_name(_is_pair), "a dictionary from names to pairs of gain and offset")
TEXTS = Kind(_by_name(TEXT.fits), "a dictionary from names to texts")
UNITS = Kind(_by_name(lambda value: value is None or TEXT.fits(value)), "a dictionary from names to texts")


def check_types(values: Mapping[str, object], kinds: Mapping[str, Kind], where: str = "") -> None:
    """Refuse values of the wrong type. None stands for an argument that is not given.

    Args:
        values: by argument.
        kinds: by argument.
        where: the beginning of the message.

    Raises:
        DataError: that names the argument, shows the value, and says what to give.
    """
    for name, kind in kinds.items():
        value = values.get(name)
        if value is not None and not kind.fits(value):
            raise DataError(f"{where}{name} is {brief(value)}; give {kind.words}", arguments=(name,))


def typed(**kinds: Kind) -> Callable[[Method], Method]:
    """A method of a named object whose arguments are checked by `check_types`."""

    def decorated(method: Method) -> Method:
        names = signature(method)

        @wraps(method)
        def checked(self: Any, *arguments: Any, **named: Any) -> Any:
            check_types(names.bind(self, *arguments, **named).arguments, kinds, f"{self.name}: ")
            return method(self, *arguments, **named)

        return checked  # type: ignore[return-value]

    return decorated


def names_of(value: object, what: str, where: str) -> tuple[str, ...]:
    """A name, or several, as a tuple of texts.

    Raises:
        DataError: for something else.
    """
    if isinstance(value, str):
        value = (value,)
    try:
        names: tuple[Any, ...] = tuple(value) if isinstance(value, Iterable) else (None,)
    except TypeError:  # an array without dimensions
        names = (None,)
    if isinstance(value, bytes | Mapping) or not all(map(_is_text, names)):
        raise DataError(f"{where}: {what} is {brief(value)}; give {NAMES.words}")
    return tuple(str(name) for name in names)


def brief(value: object) -> str:
    """A value for a message, in at most 60 characters of one line."""
    try:
        text = " ".join(repr(value).split())
    except Exception:  # an integer of very many digits, or an object without a text
        text = f"a {type(value).__name__} that is too long to show"
    return text if len(text) <= 60 else f"{text[:57]}…"
