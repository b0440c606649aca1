"""What several test files share."""

from __future__ import annotations

import os
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


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest test begins first, so that no process waits for it in the end."""
    items.sort(key=lambda item: item.path.name != "test_readme.py")
