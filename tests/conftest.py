"""What several test files share."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import settings

# Timings never decide a test.
settings.register_profile("emsid", deadline=None)
settings.load_profile("emsid")


@pytest.fixture(scope="session")
def recordings() -> Path:
    """The folder of real recordings, which is no part of the project; a test that wants it skips without it."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("EMSID_RECORDINGS", default))
    if not folder.is_dir():
        pytest.skip(f"no folder of recordings at {folder}; name it in EMSID_RECORDINGS")
    return folder


@pytest.fixture(scope="session")
def command() -> Callable[..., int]:
    """The command line, run in this process with these words: its exit status.

    A fresh interpreter takes seconds to load compiler and libraries, and is for tests of signals and of what only a
    process has.
    """
    from emsid.cli import main

    def run(*words: object) -> int:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(sys, "argv", ["emsid", *map(str, words)])
            try:
                main()
            except SystemExit as end:
                return int(end.code or 0)
        return 0

    return run


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest test begins first, so that no process waits for it in the end."""
    items.sort(key=lambda item: item.path.name != "test_readme.py")
