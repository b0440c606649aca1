"""A session: a folder with the data, what was chosen, every run, and the steps that led there.

    session.json        the steps of data and choice, for undo and redo
    data/               copies of the files
    models/             models that were added as files
    runs/1/             an identification: what was asked, models, result, report
    use/1/              controllers, compensations and designs that were made

Every file is written atomically, so that a session is complete after any interruption; it can be copied and sent.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from threading import RLock
from typing import Annotated, Any, Literal, TypedDict

import msgspec
from msgspec import Meta

from emsid.errors import DataError, FormatError
from emsid.io import atomic_write
from emsid.live.log import Lock, Taken

VERSION = 3
MOST_STEPS = 200
"""Steps that can be undone; each is a few hundred bytes."""
INCOMING = "incoming"
"""The folder of files that are being written; those that are refused do not get into ``data/``."""
FileName = Annotated[str, Meta(pattern=r"\A(?!\.{1,2}\Z)[^\x00/\\]+\Z")]
Stamp = tuple[tuple[str, int, int], ...]


class Step(TypedDict):
    """What was chosen; everything is bound to the files that it was said of.

    ``files`` (to fit), ``unseen_files`` and ``other_files`` are names in ``data/``. ``given`` are corrected arguments
    of `emsid.read` by the file that they were said of. ``models`` (none: the usual ones), ``options`` of
    `emsid.identify` with known values, and ``unseen``, the part kept unseen, were chosen for the files ``chosen_for``.
    """

    files: list[FileName]
    unseen_files: list[FileName]
    other_files: list[FileName]
    given: dict[FileName, dict[str, Any]]
    models: list[str]
    options: dict[str, Any]
    unseen: Annotated[float, Meta(gt=0, lt=1)]
    chosen_for: list[FileName]


class Document(TypedDict):
    """The content of ``session.json``."""

    format: Literal["emsid session"]
    version: Literal[3]
    at: Annotated[int, Meta(ge=0)]
    steps: Annotated[list[Step], Meta(min_length=1)]


CHOICE: dict[str, Any] = {"models": [], "options": {}, "unseen": 0.3}
"""The parts of a step that are chosen for all of its files, with their defaults."""
KINDS = ("files", "unseen_files", "other_files")
"""The lists of the files of a step: those to fit, those to rank on, and those that are only looked at."""
EMPTY: dict[str, Any] = {**{kind: [] for kind in KINDS}, "given": {}, **CHOICE, "chosen_for": []}


def named(step: Mapping[str, Any]) -> list[str]:
    """All files of a step."""
    return [name for kind in KINDS for name in step[kind]]


class Conflict(DataError):
    """Raised for a change of a state that is no longer the present one; nothing has been changed."""

    def __init__(self) -> None:
        super().__init__("the session has changed meanwhile; look at it and do it again")


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Keep other processes from changing the session in a folder, which is made where it is missing.

    Raises:
        FormatError: where the folder cannot be made or written to.
        DataError: where another process has the session.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        lock = Lock(folder / ".lock")
    except Taken as other:
        raise DataError(
            f"{folder}: {other.by} has this session open; use its page, or name another folder", arguments=("session",)
        ) from None
    except OSError as problem:
        raise FormatError(f"{folder}: cannot be written ({_reason(problem)}); choose another folder") from None
    try:
        yield
    finally:
        lock.release()


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
        folder = folder.resolve()  # its files are named to other programs, which run elsewhere
        path = folder / "session.json"
        session = cls(folder)
        try:
            if path.exists():
                found = msgspec.convert(current(msgspec.json.decode(path.read_bytes())), Document)
                session.steps, session.at = found["steps"], min(found["at"], len(found["steps"]) - 1)  # type: ignore[assignment]
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            folder.chmod(0o700)
            for left in (folder / INCOMING, *folder.glob(f".{path.name}.*.tmp")):  # of a studio that was killed
                delete(left)
            for name in ("data", "models", "runs", INCOMING):
                (folder / name).mkdir(exist_ok=True)
        except (LookupError, ValueError, TypeError, AttributeError, RecursionError, msgspec.MsgspecError):
            raise FormatError(f"{path}: not a session that this emsid reads; choose another folder") from None
        except OSError as problem:
            raise FormatError(f"{folder}: cannot be used ({_reason(problem)}); choose another folder") from None
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
            msgspec.ValidationError: where a value is of another type.
            FormatError: where it cannot be written; the session is then as before.
        """
        with self.lock:
            step: Any = msgspec.convert(bound({**self.step, **values}), Step)
            steps = [*self.steps[: self.at + 1], step][-MOST_STEPS:]
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
        document = {"format": "emsid session", "version": VERSION, "at": self.at, "steps": self.steps}
        atomic_write(self.folder / "session.json", msgspec.json.encode(document))

    def path(self, name: str, of: str = "data") -> Path:
        """A file of the data, or of the models that were added."""
        return self.folder / of / name

    def free_name(self, name: str, of: str = "data") -> str:
        """A name for a file that is added: without a folder or characters that some systems refuse, not in use yet."""
        bare = re.sub(r'[\x00-\x1f<>:"/\\|?*]', "_", Path(name.replace("\\", "/")).name).strip(". ")
        bare = bare.encode()[-120:].decode(errors="ignore") or "file"
        stem, dot, suffix = bare.partition(".")
        numbered = (f"{stem}-{k}{dot}{suffix}" for k in range(2, 10_000))
        places = (self.path(each, of) for each in (bare, *numbered))
        return next(place.name for place in places if not (place.exists() or self._incoming(place.name).exists()))

    def _incoming(self, name: str) -> Path:
        return self.folder / INCOMING / name

    @contextmanager
    def adding(self, name: str, of: str = "data") -> Iterator[tuple[str, Path]]:
        """A free name for a file of data or models, and where to write it first; after an exception within, none stays.

        Raises:
            OSError: where the folder cannot be written to.
        """
        with self.lock:
            free = self.free_name(name, of)
            incoming = self._incoming(free)
            incoming.touch(exist_ok=False)  # nobody else takes the name
        try:
            yield free, incoming
        except BaseException:
            delete(self.path(free, of))
            raise
        finally:
            delete(incoming)

    def arrived(self, name: str, of: str = "data") -> None:
        """Put a file that has been written to its place."""
        self._incoming(name).replace(self.path(name, of))

    def stamp(self, name: str) -> Stamp:
        """What changes as a file of the data, or one in it where it is a folder, is replaced.

        Raises:
            FormatError: where it is missing.
        """
        path = self.path(name)
        try:
            files = sorted(each for each in path.rglob("*") if each.is_file()) if path.is_dir() else [path]
            states = [(str(each), each.stat()) for each in files]
        except OSError as problem:
            raise FormatError(f"{path}: cannot be read ({_reason(problem)})") from None
        return tuple((each, state.st_size, state.st_mtime_ns) for each, state in states)

    def digest(self, name: str) -> str:
        """The hash of the content of a file of the data."""
        return _digest(self.stamp(name))

    def add(self, source: Path) -> str:
        """Copy a file, or a folder that is a recording, into the session; its name there.

        Raises:
            FormatError: where it cannot be read.
        """
        try:
            with self.adding(source.name) as (name, incoming):
                if source.is_dir():
                    incoming.unlink()
                    shutil.copytree(source, incoming)
                else:
                    shutil.copyfile(source, incoming)
                self.arrived(name)
        except OSError as problem:
            raise FormatError(f"{source}: cannot be read ({_reason(problem)})") from None
        return name

    def new_folder(self, of: str) -> Path:
        """An empty folder for a run, or for files that are made, with the next number."""
        with self.lock:
            numbers = [int(path.name) for path in (self.folder / of).glob("*") if path.name.isdigit()]
            folder = self.folder / of / str(max(numbers, default=0) + 1)
            folder.mkdir(parents=True)
            return folder

    @property
    def runs(self) -> list[Path]:
        """The folders of the runs, by number."""
        found = [path for path in (self.folder / "runs").iterdir() if path.name.isdigit()]
        return sorted(found, key=lambda path: int(path.name))


def bound(step: dict[str, Any]) -> dict[str, Any]:
    """A step without what was said of other data: corrections of files that it lacks, and a choice for other files.

    A choice holds for the files that it was made for, and for further ones as long as the first file is one of them.
    """
    names = named(step)
    given = {name: each for name, each in step["given"].items() if name in names and each}
    other = step["files"] and step["chosen_for"] and step["files"][0] not in step["chosen_for"]
    return {**step, "given": given, **({**CHOICE, "chosen_for": []} if other else {})}


def current(found: dict[str, Any]) -> dict[str, Any]:
    """The content of a session file in the present version.

    In the first one, corrections were of all files; in the second one, every file was used.
    """
    if found["version"] not in (1, 2):
        return found
    steps = [{**EMPTY, **step} for step in found["steps"]]
    for step in steps if found["version"] == 1 else ():
        step["chosen_for"] = [*step["files"], *step["unseen_files"]]
        step["given"] = dict.fromkeys(step["files"][:1], step["given"]) if step["given"] else step["given"]
    return {**found, "version": VERSION, "steps": steps}


@lru_cache(maxsize=1024)
def _digest(stamp: Stamp) -> str:
    found = sha256()
    with suppress(OSError):  # a file that is deleted meanwhile has another stamp
        for name, *_ in stamp:
            with open(name, "rb") as file:
                while block := file.read(1 << 20):
                    found.update(block)
    return found.hexdigest()


def delete(path: Path) -> None:
    """Delete a file or a folder, if it is there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _reason(problem: OSError) -> str:
    return (problem.strerror or str(problem)).lower()


def in_session(folder: Path, name: str) -> Path | None:
    """A file below a folder by its relative path; None where it is none, or lies elsewhere."""
    try:
        path = (folder / name).resolve()
        return path if path.is_file() and path.is_relative_to(folder.resolve()) else None
    except (OSError, ValueError):  # a name too long, or with a null character
        return None
