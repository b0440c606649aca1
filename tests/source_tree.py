"""Files of Python as the tests of the source tree look at them: parsed and walked through once."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path


@cache
def nodes_of(path: Path) -> tuple[ast.AST, ...]:
    """Every node of a file; the first is its module."""
    return tuple(ast.walk(ast.parse(path.read_text("utf-8"))))
