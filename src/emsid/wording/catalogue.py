"""The codes of findings: the severity of each, and the function that makes its sentence."""

from __future__ import annotations

import re
from collections import ChainMap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from string import Formatter
from typing import Any

from emsid.findings import Finding
from emsid.units import with_unit
from emsid.wording import lists

Spelling = Callable[[str], str]
"""How the name of an argument is written: ``mask`` in Python, ``--mask`` on a command line."""


class Severity(Enum):
    """How much a finding matters to a user of the model."""

    INFO = "info"  # information
    WARNING = "warning"  # limits what the result can be used for
    PROBLEM = "problem"  # the result should not be used until this is corrected


@dataclass(frozen=True)
class Entry:
    """A code of the catalogue.

    Attributes:
        severity: how much it matters.
        wording: the sentence of a finding, without the full stop and without the model that it is about.
    """

    severity: Severity
    wording: Callable[[Finding, Spelling], str]


CATALOGUE: dict[str, Entry] = {}
"""All codes."""


def words(
    code: str, severity: Severity = Severity.INFO
) -> Callable[[Callable[[Finding, Spelling], str]], Callable[[Finding, Spelling], str]]:
    """Register a function as the wording of a code.

    Args:
        code: the code; each is registered once.
        severity: how much it matters.
    """

    def register(wording: Callable[[Finding, Spelling], str]) -> Callable[[Finding, Spelling], str]:
        if code in CATALOGUE:
            raise ValueError(f"two wordings for {code!r}")
        CATALOGUE[code] = Entry(severity, wording)
        return wording

    return register


def sentences(module: str, table: str, **parts: str) -> None:
    """Register the rows ``code severity: sentence`` of a table; indented lines continue a row.

    A row may end with a line ``# Subject: … Data: …`` that says what a finding holds. `filled` fills the braces in a
    sentence with the data of a finding, its ``subject`` and ``model``, ``argument[mask]`` for the name of an argument,
    and parts that several rows share.

    Args:
        module: that has the table.
        table: the rows.
        parts: sentences by the names that rows know them by.
    """

    def worded(template: str, holds: str) -> Callable[[Finding, Spelling], str]:
        def wording(f: Finding, argument: Spelling) -> str:
            given = {"model": f.model, **f.data, "subject": f.subject, "argument": _Spelt(argument)}
            return filled(template, _Values(given, parts))

        wording.__module__, wording.__doc__ = module, holds or None
        return wording

    for begins, row in rows(table).items():
        code, severity = begins.split()
        template, _, holds = row.partition(" # ")
        words(code, Severity(severity))(worded(template, holds))


def rows(table: str) -> dict[str, str]:
    """The sentences of a table by what stands before their first colon; indented lines continue a row."""
    found = re.findall(r"^([^ :\n][^:\n]*): (.+(?:\n +.+)*)", table, re.MULTILINE)
    return {begins: re.sub(r"\n +", " ", row) for begins, row in found}


def filled(template: str, values: Mapping[str, Any], items: Sequence[Any] = ()) -> str:
    """A sentence with its braces filled, as by `str.format` but for these formats:

    ======================  ============================================================================================
    ``.2g %``               100 times the number, with the sign of percent
    ``.4g[unit]``           the number with the unit that another value names; ``short[unit]`` has three digits
    ``sample/samples``      one word for 1, or a list of one, and another for more
    ``?then|otherwise``     a sentence where the value is true, another one where it is not
    ``up=>above|below``     the sentence of a value; the last may be for all others
    ``list``, ``some``      texts joined, all or the first few; ``list .3g`` and ``list {name} {0:.3g}`` give the format
                            of a member, ``or``, ``and``, ``commas``, ``spaced`` join by these
    ``duration`` and more   see `emsid.wording.lists`: ``sample_time``, ``sure``, ``ordinal``, ``chance``
    ``assign -1``           the value of an argument for a column of this name
    ``option``              the name of an argument, as it is spelt
    ======================  ============================================================================================

    Args:
        template: the sentence.
        values: by name; one that is missing is None.
        items: by number.

    Raises:
        KeyError: where a value is missing, and the format does not say what to write then.

    >>> filled("{n} {n:step/steps}, {left:.2g %}{at:?, at {at:.2g[unit]}}", {"n": 2, "left": 0.5, "at": 3, "unit": "V"})
    '2 steps, 50 %, at 3 V'
    """
    said = []
    for text, field, how, conversion in _READ.parse(template):
        said.append(text)
        if field is not None and how is not None:
            value, _ = _READ.get_field(field, items, values)
            if value is None and not how.startswith("?") and "=>" not in how:
                raise KeyError(f"no value for {field!r} in {template!r}")
            said.append(_worded(repr(value) if conversion == "r" else value, how, values, items))
    return "".join(said)


class _Values(dict[str, Any]):
    """The data of a finding, and parts of sentences, which are filled when they are needed."""

    def __init__(self, given: Mapping[str, Any], parts: Mapping[str, str]) -> None:
        super().__init__(given)
        self.parts = parts

    def __missing__(self, name: str) -> str:
        return filled(self.parts[name], self)


class _Spelt(dict[str, str]):
    """The names of arguments as they are spelt."""

    def __init__(self, argument: Spelling) -> None:
        self.argument = argument

    def __missing__(self, name: str) -> str:
        return self.argument(name)


class _Reader(Formatter):
    """Reads fields of a sentence; a value that is missing is None."""

    def get_value(self, key: int | str, args: Sequence[Any], kwargs: Mapping[str, Any]) -> Any:
        try:
            return args[key] if isinstance(key, int) else kwargs[key]
        except KeyError:
            return None


_READ = _Reader()
_JOINED: dict[str, Callable[[list[str]], str]] = {
    "list": lists.listed,
    "some": lists.shortened,
    "or": " or ".join,
    "and": " and ".join,
    "commas": ", ".join,
    "spaced": " ".join,
}
_NAMED: dict[str, Callable[[Any], object]] = {
    "duration": lists.duration,
    "sample_time": lists.sample_time,
    "sure": lists.how_sure,
    "ordinal": lists.ordinal,
    "chance": lists.chance,
    "len": len,
    "short": lists.short,
}


def _worded(value: Any, how: str, values: Mapping[str, Any], items: Sequence[Any]) -> str:
    """A value in one of the formats of `filled`."""
    first, _, rest = how.partition(" ")
    if how.startswith("?"):
        then, *otherwise = _alternatives(how[1:])
        return filled(then if value else "".join(otherwise), values, items)
    if first in _JOINED:
        members = list(value.items() if isinstance(value, Mapping) else value)
        return _JOINED[first]([_member(each, rest, values) for each in members])
    if "=>" in how:
        by_value = dict(each.rpartition("=>")[::2] for each in _alternatives(how))
        return filled(by_value.get(str(value), by_value.get("", "")), values, items)
    if how in _NAMED:
        return str(_NAMED[how](value))
    if first == "assign":
        return lists.assigned(value, filled(rest, values, items))
    if how == "option":
        return str(values["argument"][value])
    if how.endswith("]"):
        number, _, unit = how[:-1].partition("[")
        return with_unit(_worded(value, number, values, items), _READ.get_field(unit, items, values)[0])
    if how.endswith(" %"):
        return f"{format(100 * value, how[:-2])} %"
    if "/" in how:
        one, several = how.split("/")
        return one if (value if isinstance(value, int | float) else len(value)) == 1 else several
    return format(value, how)


def _member(member: Any, how: str, values: Any) -> str:
    """A member of a list: in a format, or in a sentence of its own with what it has by name or by number."""
    if "{" not in how:
        return _worded(member, how, values, ())
    own = [dict(member)] if isinstance(member, Mapping) else []
    return filled(how, ChainMap(*own, values), member if isinstance(member, list | tuple) else (member,))


def _alternatives(how: str) -> list[str]:
    """Sentences between bars, which may hold bars within braces."""
    parts, depth = [""], 0
    for letter in how:
        depth += (letter == "{") - (letter == "}")
        if letter == "|" and not depth:
            parts.append("")
        else:
            parts[-1] += letter
    return parts


def as_python(name: str) -> str:
    """The name of an argument in Python."""
    return name


def sentence(finding: Finding, argument: Spelling = as_python) -> str:
    """A finding as one sentence with a full stop; it begins with the model that the finding is about.

    Args:
        finding: what was noticed.
        argument: how names of arguments are written.
    """
    text = CATALOGUE[finding.code].wording(finding, argument).rstrip(".")
    about = f"{finding.model}: " if finding.model else ""
    return f"{text}." if text.startswith(about) else f"{about}{text}."


def severity(finding: Finding) -> Severity:
    """The severity of a finding."""
    return CATALOGUE[finding.code].severity
