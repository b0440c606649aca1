"""Names that were replaced, which still work for a release, and names of MATLAB's toolbox, which name ours."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Mapping
from typing import Any


def with_old_names(
    module: str,
    get: Callable[[str], Any],
    renamed: Mapping[str, str],
    elsewhere: Mapping[str, str] | None = None,
) -> Callable[[str], Any]:
    """A module's ``__getattr__`` that also answers old names, with a DeprecationWarning.

    Args:
        module: its name.
        get: what answers the present names.
        renamed: the present name for every old one.
        elsewhere: what to write here for a name of another program, for the message.
    """

    def answer(name: str) -> Any:
        if name not in renamed:
            try:
                return get(name)
            except AttributeError:
                if elsewhere is None or name.startswith("_"):
                    raise
            from emsid.arguments import did_you_mean

            here = elsewhere.get(name)
            near = f"; write {here}" if here else did_you_mean(name, dir(sys.modules[module]))
            raise AttributeError(f"{module} has no {name!r}{near}")
        now = renamed[name]
        text = f"{module}.{name} is now {module}.{now}; the old name will be removed in the next release"
        warnings.warn(text, DeprecationWarning, stacklevel=2)
        return getattr(sys.modules[module], now)

    return answer
