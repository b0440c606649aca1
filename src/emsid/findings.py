"""`Finding`: one fact about data, a model or a search, as data and not as a sentence.

`emsid.wording` is the only place that makes sentences of findings. The terminal, the page and ``result.json`` show the
same list of findings.
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
    """One fact about data, a model or a search.

    Args:
        code: the kind of finding, in small letters with hyphens: ``input-constant``. `emsid.wording` lists the codes.
        subject: the name of the model, parameter, channel or record that it concerns; may be empty.
        data: the values in its sentence, by name: finite numbers, texts, booleans, None, and lists and tables of these,
            so that it can be written as JSON. ``model`` is the name of the model that it is about, if there is one.

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
    """Data for JSON: numbers that are infinite or not a number become None, at any depth."""
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(each) for each in value]
    if isinstance(value, float):
        return finite(value)
    return value


def finite(value: float) -> float | None:
    """A number for the data of a finding; None where it is infinite or not a number, which JSON cannot hold."""
    return float(value) if isfinite(value) else None
