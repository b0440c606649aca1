"""`Finding`: one thing that the program has to say about data, a model or a search, as data and not as a sentence.

Whoever notices something returns a `Finding`; nobody builds a sentence and nobody parses one. `emsid.wording` is the
only place that turns findings into sentences; the terminal, the page and ``result.json`` are views of the same list.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Finding:
    """One thing that was noticed.

    Args:
        code: what kind of thing, in small letters with hyphens: ``input-constant``. The codes are listed in
            `emsid.wording`.
        subject: what it concerns: a model, a parameter, a channel or a record, by its name; may be empty.
        data: what its sentence needs, by name: numbers, texts, booleans, None, and lists and tables of these, so that
            it can be written as JSON.

    Raises:
        ValueError: for a code of another form.
    """

    code: str
    subject: str = ""
    data: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", self.code):
            raise ValueError(f"finding code {self.code!r}; use small letters, digits and hyphens")

    def to_data(self) -> dict[str, Any]:
        """Code, subject and data in built-in types."""
        return {"code": self.code, "subject": self.subject, "data": dict(self.data)}
