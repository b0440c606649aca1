"""`Finding`: one thing that the program noticed about data, a model or a search, as data and not as a sentence.

The code that notices something returns a `Finding`. `emsid.wording` is the only place that makes a sentence of it; the
terminal, the page and ``result.json`` are views of the same list.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Any

__all__ = ["Finding"]


@dataclass(frozen=True)
class Finding:
    """One thing that was noticed.

    Args:
        code: what kind of thing, in small letters with hyphens: ``input-constant``. The codes are listed in
            `emsid.wording`.
        subject: what it concerns: a model, a parameter, a channel or a record, by its name; may be empty.
        data: what its sentence needs, by name: finite numbers, texts, booleans, None, and lists and tables of these, so
            that it can be written as JSON. ``model`` is the name of the model that it is about, where there is one.

    Raises:
        ValueError: for a code of another form.
    """

    code: str
    subject: str = ""
    data: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", self.code):
            raise ValueError(f"finding code {self.code!r}; use small letters, digits and hyphens")

    @property
    def model(self) -> str:
        """The model that it is about; empty where it is about none."""
        return str(self.data.get("model", ""))

    def about(self, model: str) -> Finding:
        """The same about this model, for a list of findings on several models."""
        return replace(self, data={**self.data, "model": model})

    def to_data(self) -> dict[str, Any]:
        """Code, subject and data in built-in types."""
        return {"code": self.code, "subject": self.subject, "data": dict(self.data)}


def plain(value: Any) -> Any:
    """Data as JSON holds them: numbers that are infinite or not a number become None, whatever they are nested in."""
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(each) for each in value]
    if isinstance(value, float):
        return finite(value)
    return value


def finite(value: float) -> float | None:
    """A number for the data of a finding; None where it is infinite or not a number, which JSON has no words for."""
    return float(value) if isfinite(value) else None
