"""Names that were replaced: the old one still works for a release, and says which name replaces it."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Mapping
from typing import Any


def with_old_names(module: str, get: Callable[[str], Any], renamed: Mapping[str, str]) -> Callable[[str], Any]:
    """A module's ``__getattr__`` that also answers old names, with a DeprecationWarning.

    Args:
        module: its name.
        get: what answers the present names.
        renamed: the present name for every old one.
    """

    def answer(name: str) -> Any:
        if name not in renamed:
            return get(name)
        now = renamed[name]
        text = f"{module}.{name} is now {module}.{now}; the old name will be removed in the next release"
        warnings.warn(text, DeprecationWarning, stacklevel=2)
        return getattr(sys.modules[module], now)

    return answer
