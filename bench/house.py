"""The size of the program, and how much of it one identification passes through.

    python bench/house.py

It counts lines and files of ``src/`` and ``tests/``, and the functions, files and the depth of calls of the package
that ``emsid.identify(record, models="rigid-motor", fixed={"resistance": 2})`` calls on the record of a motor. Functions
that are called while a module is imported do not count: another record is identified before.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import emsid
from arguments import parser_of

HOME = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(HOME / "tests"))
from independent.systems import SYSTEMS  # noqa: E402

PACKAGE = str(Path(emsid.__file__).parent)


class Passed:
    """A profile hook that notes the functions of the package that are called.

    Attributes:
        functions: their code.
        deepest: the most of them that were under way at once.
    """

    def __init__(self) -> None:
        self.functions: set[CodeType] = set()
        self.deepest = 0
        self._depth = threading.local()

    def __call__(self, frame: FrameType, event: str, _: Any) -> None:
        """Note a call or a return."""
        if event not in ("call", "return") or not frame.f_code.co_filename.startswith(PACKAGE):
            return
        depth = getattr(self._depth, "value", 0) + (1 if event == "call" else -1)
        self._depth.value = depth
        self.deepest = max(self.deepest, depth)
        self.functions.add(frame.f_code)

    def files(self) -> set[str]:
        """Those of the functions."""
        return {code.co_filename for code in self.functions}


def passed(run: Callable[[], object]) -> Passed:
    """What a call passes through, in all of its threads."""
    hook = Passed()
    threading.setprofile(hook)
    sys.setprofile(hook)
    try:
        run()
    finally:
        sys.setprofile(None)
        threading.setprofile(None)  # type: ignore[arg-type]
    return hook


def size(folder: str) -> str:
    """Lines and files of Python below a folder."""
    files = sorted((HOME / folder).rglob("*.py"))
    return f"{folder}: {sum(len(file.read_text('utf-8').splitlines()) for file in files):,} lines in {len(files)} files"


def main() -> None:
    """Print the counts."""
    parser_of(__doc__).parse_args()

    def identified(seed: int) -> None:
        emsid.identify(SYSTEMS["motor"][1].pair(seed).fitted, models="rigid-motor", fixed={"resistance": 2})

    identified(1)
    before = time.process_time()
    identified(0)
    seconds = time.process_time() - before
    found = passed(lambda: identified(0))
    print(size("src"), size("tests"), sep="\n")
    print(
        f"identify, a rigid motor: {len(found.functions):,} functions in {len(found.files())} files, "
        f"{found.deepest} deep; {seconds:.1f} s of CPU without the profile hook"
    )


if __name__ == "__main__":
    main()
