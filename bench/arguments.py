"""The arguments of the scripts: which of their parts they are to print."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence


def parser_of(doc: str | None) -> argparse.ArgumentParser:
    """A parser whose ``--help`` shows the script's docstring."""
    return argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)


def asked_parts(doc: str | None, parts: Iterable[str], arguments: Sequence[str] | None = None) -> list[str]:
    """The parts that the command line names, by default all; a name may be followed by ``=`` and cases of the part."""
    known = list(parts)
    parser = parser_of(doc)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"one of {', '.join(known)} (default: all)")
    asked: list[str] = parser.parse_args(arguments).parts
    for name in asked:
        if name.partition("=")[0] not in known:
            parser.error(f"there is no part {name}; name one of {', '.join(known)}")
    return asked or known


def numbers(text: str) -> list[int]:
    """The numbers of simulated systems, such as ``0-19``, the last one included, or ``0-2,61``."""
    found: list[int] = []
    for part in text.split(","):
        first, _, last = part.partition("-")
        found += range(int(first), int(last or first) + 1)
    return found
