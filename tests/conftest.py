"""What several test files share, and how a test process is kept cheap."""

from __future__ import annotations

import gc
import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

# One thread for linear algebra and for tables in each test process and in those it starts: several test processes
# share the cores, and threads that wait for each other cost a fifth more. NumPy and Polars read this when loaded.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "POLARS_MAX_THREADS"):
    os.environ.setdefault(_variable, "1")
# No collection of garbage while modules are loaded; see `pytest_collection_finish`.
gc.disable()

import pytest  # noqa: E402
from hypothesis import settings  # noqa: E402

from command_line import table  # noqa: E402

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


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Call the command line in this process: (status, standard output, standard error)."""
    from emsid.cli import main

    def call(*words: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["emsid", *map(str, words)])
        status = 0
        try:
            main()
        except SystemExit as end:
            status = int(end.code or 0)
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return call


@pytest.fixture
def ctrl_c_heard() -> Iterator[None]:
    """Ctrl-C is heard, also where the tests run in the background of a shell that has it ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler), signal.getsignal(signal.SIGTERM)
    yield
    signal.signal(signal.SIGINT, before[0])
    signal.signal(signal.SIGTERM, before[1])


@pytest.fixture
def figures_undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are empty files. The README and the tests of the report draw them."""
    monkeypatch.setattr("emsid.report.figures.draw", lambda _, formats: dict.fromkeys(formats, b""))


@pytest.fixture
def no_refinements(monkeypatch: pytest.MonkeyPatch) -> None:
    """Physical candidates without the search for refinements, which takes its time."""
    from emsid.identification.candidates import CANDIDATES

    for name in ("rigid-motor", "linear-axis"):
        monkeypatch.setitem(CANDIDATES, name, replace(CANDIDATES[name], effects=()))


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A CSV with input u and output y of a first-order system."""
    return table(tmp_path / "log.csv")


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    """A file of columns by name, or of the given text."""

    def write(
        columns: dict[str, Sequence[float]] | str, name: str = "log.csv", encoding: str = "utf-8", **rows: str
    ) -> Path:
        if isinstance(columns, str):
            text = columns
        else:
            lines = [",".join(f"{x:.10g}" for x in row) for row in zip(*columns.values(), strict=True)]
            text = "\n".join([",".join(columns), *rows.values(), *lines]) + "\n"
        path = tmp_path / name
        path.write_text(text, encoding)
        return path

    return write


@pytest.fixture(scope="session")
def motor_log(tmp_path_factory: pytest.TempPathFactory, command: Callable[..., int]) -> Path:
    """A CSV of a simulated motor."""
    path = tmp_path_factory.mktemp("motor") / "motor.csv"
    assert command("simulate", "--duration", 4, "--out", path) == 0
    return path


def try_few_refinements(patch: pytest.MonkeyPatch) -> None:
    """Candidates that are plants try four additions: to try all takes seconds, and has tests of its own."""
    patch.setattr("emsid.models.plants.search.choice.moves_of", lambda plant: ("dead-zone", "delay", "lag", "load"))


def pytest_collection_finish() -> None:
    """Modules and tests stay to the end: the collector does not look through them again, and runs less often."""
    gc.freeze()
    gc.set_threshold(50_000, 10, 10)
    gc.enable()
