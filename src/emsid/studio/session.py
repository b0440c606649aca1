"""A session: a folder with the data, what was chosen, every run, and the steps that led there.

    session.json        the steps of data and choice, for undo and redo
    data/               copies of the files
    runs/1/             an identification: what was asked, models, result, report

Every file is written atomically, so that a session is complete after any interruption; it can be copied and sent.
"""

from __future__ import annotations

import re
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from threading import RLock
from typing import Any

import msgspec

from emsid.errors import DataError, FormatError
from emsid.io import atomic_write

FORMAT, VERSION = "emsid session", 1
MOST_STEPS = 200
"""Steps that can be undone; each is a few hundred bytes."""
EMPTY: dict[str, Any] = {
    "files": [],
    "unseen_files": [],
    "unseen": 0.3,
    "given": {},
    "models": [],
    "options": {},
}
"""A step: names of files in ``data/``, those of unseen data, the part kept unseen, corrected arguments of `emsid.read`,
names of the models (none: the usual ones), and options of `emsid.identify`."""


class Conflict(DataError):
    """Raised for a change of a state that is no longer the present one; nothing has been changed."""

    def __init__(self) -> None:
        super().__init__("the session has changed meanwhile; look at it and do it again")


@dataclass
class Session:
    """The state of a studio in its folder.

    Args:
        folder: where it is.
        steps: the states up to now, and those that were undone.
        at: the number of the present one.
        version: how often the state was changed since the session was opened.
    """

    folder: Path
    steps: list[dict[str, Any]] = field(default_factory=lambda: [dict(EMPTY)])
    at: int = 0
    version: int = 0
    lock: Any = field(default_factory=RLock)

    @classmethod
    def at_folder(cls, folder: Path) -> Session:
        """The session in a folder, or a new one.

        Raises:
            FormatError: where the folder has a file ``session.json`` that is none.
        """
        path = folder / "session.json"
        session = cls(folder)
        if path.exists():
            try:
                found = msgspec.json.decode(path.read_bytes())
                if (found["format"], found["version"]) != (FORMAT, VERSION):
                    raise ValueError
                session.steps = [checked({**EMPTY, **step}) for step in found["steps"]]
                session.steps[0]  # there is always a step
                session.at = min(max(int(found["at"]), 0), len(session.steps) - 1)
            except (LookupError, ValueError, TypeError, RecursionError, msgspec.DecodeError):
                raise FormatError(f"{path}: not a session that this emsid reads; choose another folder") from None
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder.chmod(0o700)
        (folder / "data").mkdir(parents=True, exist_ok=True)
        (folder / "runs").mkdir(exist_ok=True)
        session.save()
        return session

    @property
    def step(self) -> dict[str, Any]:
        """The present step."""
        return self.steps[self.at]

    @property
    def present(self) -> tuple[int, dict[str, Any]]:
        """The version and its step, which belong together."""
        with self.lock:
            return self.version, self.step

    def change(self, on: int, **values: Any) -> None:
        """Add a step with other values; steps that were undone are forgotten.

        Args:
            on: the version that the change was made on.
            values: of the step.

        Raises:
            Conflict: where this is not the present version.
            FormatError: where it cannot be written; the session is then as before.
        """
        with self.lock:
            steps = [*self.steps[: self.at + 1], {**self.step, **values}][-MOST_STEPS:]
            self._commit(on, steps, len(steps) - 1)

    def move(self, on: int, by: int) -> None:
        """Undo (−1) or redo (+1) a step, where there is one; arguments and errors as in `change`."""
        with self.lock:
            self._commit(on, self.steps, min(max(self.at + by, 0), len(self.steps) - 1))

    def _commit(self, on: int, steps: list[dict[str, Any]], at: int) -> None:
        if on != self.version:
            raise Conflict
        before = self.steps, self.at
        self.steps, self.at = steps, at
        try:
            self.save()
        except BaseException:
            self.steps, self.at = before
            raise
        self.version += 1

    def save(self) -> None:
        """Write ``session.json``."""
        document = {"format": FORMAT, "version": VERSION, "at": self.at, "steps": self.steps}
        atomic_write(self.folder / "session.json", msgspec.json.encode(document))

    def path(self, name: str) -> Path:
        """A file of the data."""
        return self.folder / "data" / name

    def free_name(self, name: str) -> str:
        """A name for a file that is added: without a folder or characters that some systems refuse, not in use yet."""
        bare = re.sub(r'[\x00-\x1f<>:"/\\|?*]', "_", Path(name.replace("\\", "/")).name).strip(". ")
        bare = bare.encode()[-120:].decode(errors="ignore") or "file"
        stem, dot, suffix = bare.partition(".")
        numbered = (f"{stem}-{k}{dot}{suffix}" for k in range(2, 10_000))
        return next(each for each in (bare, *numbered) if not self.path(each).exists())

    def reserve(self, name: str) -> str:
        """A free name, taken by an empty file, so that nobody else takes it.

        Raises:
            FormatError: where the folder cannot be written to.
        """
        with self.lock:
            free = self.free_name(name)
            try:
                self.path(free).touch(exist_ok=False)
            except OSError as problem:
                raise FormatError(f"{free}: cannot be written ({(problem.strerror or str(problem)).lower()})") from None
            return free

    def add(self, source: Path) -> str:
        """Copy a file, or a folder that is a recording, into the session; its name there.

        Raises:
            FormatError: where it cannot be read.
        """
        name = self.free_name(source.name)
        part = self.path(f".{name}.part")
        try:
            if source.is_dir():
                shutil.copytree(source, part)
            else:
                shutil.copyfile(source, part)
            part.replace(self.path(name))
        except OSError as problem:
            raise FormatError(f"{source}: cannot be read ({(problem.strerror or str(problem)).lower()})") from None
        return name

    def new_run(self) -> Path:
        """An empty folder for a run, with the next number."""
        with self.lock:
            numbers = [int(path.name) for path in (self.folder / "runs").iterdir() if path.name.isdigit()]
            folder = self.folder / "runs" / str(max(numbers, default=0) + 1)
            folder.mkdir()
            return folder

    @property
    def runs(self) -> list[Path]:
        """The folders of the runs, by number."""
        found = [path for path in (self.folder / "runs").iterdir() if path.name.isdigit()]
        return sorted(found, key=lambda path: int(path.name))


def checked(step: dict[str, Any]) -> dict[str, Any]:
    """A step of a session file.

    Raises:
        ValueError: where it has parts of other types, or files outside the session.
    """
    for key, value in EMPTY.items():
        if not isinstance(step[key], type(value)):
            raise ValueError(key)
    for name in (*step["files"], *step["unseen_files"]):
        if not isinstance(name, str) or name in ("", ".", "..") or re.search(r"[\x00/\\]", name):
            raise ValueError(name)
    return step


def in_session(folder: Path, name: str) -> Path | None:
    """A file below a folder by its relative path; None where it is none, or lies elsewhere."""
    try:
        path = (folder / name).resolve()
        return path if path.is_file() and path.is_relative_to(folder.resolve()) else None
    except (OSError, ValueError):  # a name too long, or with a null character
        return None
