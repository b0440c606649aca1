"""Reading and writing of files: a file is read completely, and written completely or not at all."""

from __future__ import annotations

import gzip
import json
import os
import stat
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from contextvars import ContextVar, copy_context
from difflib import get_close_matches
from errno import EISDIR
from importlib.resources import files
from io import BytesIO
from pathlib import Path
from secrets import token_hex
from typing import Any

import msgspec

from emsid.errors import FormatError
from emsid.replacing import is_source, note_result, note_source

_SIGNATURES = (
    (b"\x89PNG", "a PNG image"),
    (b"\xff\xd8\xff", "a JPEG image"),
    (b"GIF8", "a GIF image"),
    (b"%PDF", "a PDF document"),
    (b"PK\x03\x04", "a ZIP archive (an NPZ file or a spreadsheet)"),
    (b"\xd0\xcf\x11\xe0", "an old spreadsheet or document"),
    (b"\x1f\x8b", "a gzip archive"),
    (b"\x89HDF", "an HDF5 file"),
    (b"MATLAB", "a MAT file"),
    (b"PAR1", "a Parquet file"),
    (b"\x93NUMPY", "an NPY file"),
    (b"SQLite", "a database"),
)

LARGEST = 2**31
"""Bytes that a packed file may have when it is unpacked."""
EXPANSION, SMALL = 64, 2**28
"""A packed file may have this many times its bytes when it is unpacked, and `SMALL` bytes in every case: measured
signals have noise, and become 3 to 20 times smaller."""
AT_ONCE = 8
"""So many files are written at the same time."""
_OPEN_FILES = ("/proc/", "/dev/fd/")  # the open files of this program


class NotWritten(FormatError):
    """A file cannot be written, such as on a full disk."""


def not_written(path: Path, problem: Exception) -> NotWritten:
    """The error about a file that cannot be written."""
    return NotWritten(f"{path}: cannot be written ({_reason(problem)}); choose another place or free this one")


def check_target(path: str | os.PathLike[str]) -> None:
    """Refuse to write to a file that this command has read.

    Raises:
        FormatError: that names the file.
    """
    if is_source(path):
        raise FormatError(f"{path}: this command reads this file and would replace it; write to another place")


def read_bytes(path: str | os.PathLike[str], if_empty: str = "record it again", *, replaceable: bool = False) -> bytes:
    """The content of a file.

    Args:
        path: the file; a pipe only where it is open already, as ``/dev/stdin`` is, since another may never end.
        if_empty: what to do about an empty one.
        replaceable: whether a command that reads it may write a new version of it.

    Raises:
        FormatError: where it is missing (naming files with a similar name), a folder, a pipe or device, empty or
            unreadable.
    """
    path = Path(path)
    try:
        status = path.stat()
        kind = status.st_mode
        if not (stat.S_ISREG(kind) or stat.S_ISDIR(kind) or path.resolve().as_posix().startswith(_OPEN_FILES)):
            raise FormatError(f"{path}: this is a pipe or a device, which may never end; name a file")
        if stat.S_ISREG(kind):
            _refuse_empty_space(path, status)
        content = path.read_bytes()
        if not replaceable:
            note_source(status)
    except FileNotFoundError:
        raise FormatError(f"{path}: there is no such file{_similar(path)}") from None
    except IsADirectoryError:
        raise FormatError(f"{path}: this is a folder; name a file in it") from None
    except (OSError, ValueError) as problem:  # ValueError: a name with a null character
        raise FormatError(f"{path}: cannot be read ({_reason(problem)}); check the name and its permissions") from None
    if not content:
        raise FormatError(f"{path}: the file is empty; {if_empty} or name another")
    return content


def is_large(path: Path, least: int) -> bool:
    """Whether there is a file of at least this many bytes, which is then read, but not completely (`read_bytes`).

    Raises:
        FormatError: where it was not written completely.
    """
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode) or status.st_size < least:
            return False
        _refuse_empty_space(path, status)
    except (OSError, ValueError):
        return False
    note_source(status)
    return True


def _refuse_empty_space(path: Path, status: os.stat_result) -> None:
    """Refuse a file that hardly uses the disk, or begins with zeros, before it is read: it was never written fully."""
    held = getattr(status, "st_blocks", status.st_size) * 512
    if status.st_size > SMALL and held * EXPANSION < status.st_size:
        raise FormatError(
            f"{path}: this file of {status.st_size / 2**20:,.0f} MiB holds {held / 2**20:.3g} MiB, the rest is empty "
            "space; it was not written completely: copy or record it again"
        )
    with open(path, "rb") as file:
        head = file.read(4096)
    if len(head) == 4096 and not any(head):
        raise FormatError(f"{path}: this file begins with zeros only; it was not written: copy or record it again")


def check_expansion(packed: int, size: int) -> None:
    """Refuse a packed file that is absurdly large when it is unpacked.

    Args:
        packed: its bytes.
        size: its bytes, unpacked.

    Raises:
        FormatError: that says how large.
    """
    if size > min(LARGEST, max(SMALL, EXPANSION * packed)):
        times = f"{size / max(packed, 1):,.0f} times its size"
        raise FormatError(
            f"unpacked, this file has more than {size / 2**20:,.0f} MiB, {times}; no record is packed so well: unpack "
            "it and take a part"
        )


def gunzipped(content: bytes) -> bytes:
    """The content of a file that is packed by gzip.

    Raises:
        FormatError: where it is damaged or no such file, or too large when unpacked (`check_expansion`).
    """
    most = min(LARGEST, max(SMALL, EXPANSION * len(content)))
    try:
        with gzip.open(BytesIO(content)) as packed:
            result = packed.read(most + 1)
    except (OSError, EOFError, zlib.error) as problem:
        raise FormatError(f"this is no gzip file, or a damaged one ({problem}); pack it again") from None
    check_expansion(len(content), len(result))
    return result


def looks_like(content: bytes) -> str:
    """The kind of a file by its first bytes: ``a PNG image``, ``text``, ``binary data`` …"""
    for signature, what in _SIGNATURES:
        if content.startswith(signature):
            return what
    return "binary data" if any(byte < 9 for byte in content[:4096]) else "text"


def first_bytes(path: str | os.PathLike[str]) -> bytes | None:
    """At most 4,096 bytes from the beginning of a file; None where it cannot be read."""
    try:
        with open(path, "rb") as file:
            return file.read(4096)
    except OSError:
        return None


def atomic_write(path: str | os.PathLike[str], content: bytes | str) -> None:
    """Write a file atomically: at every moment it is complete, with the old or the new content.

    The content is written to a temporary file in the same folder, forced to disk and renamed; within `together` it is
    renamed at the end of that. After an error or Ctrl-C the old file remains, and the temporary file and folders that
    were made for it are deleted.

    Args:
        path: the file.
        content: text is written as UTF-8.

    Raises:
        NotWritten: where the folder cannot be made or written to, or ``path`` is itself a folder.
        FormatError: for a file that the command has read (`emsid.replacing`).
    """
    with together() as files:
        files.add(Path(path), content.encode() if isinstance(content, str) else content)


class _Files:
    """Files that are written completely before the first of them gets its name."""

    def __init__(self) -> None:
        self._written: dict[Path, Path] = {}  # temporary files by the names that they will get
        self._folders: list[Path] = []  # that were made for them
        self.problem: NotWritten | None = None

    def add(self, path: Path, content: bytes) -> None:
        """Write a temporary file; after a failure none of the files gets its name."""
        check_target(path)
        temporary = path.with_name(f".{path.name}.{token_hex(4)}.tmp")
        with self._reported(path):
            missing = [each for each in path.parents if not each.exists()]
            self._folders += missing
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.is_dir():
                raise IsADirectoryError(EISDIR, os.strerror(EISDIR))
            earlier = self._written.get(path)
            self._written[path] = temporary
            with open(temporary, "xb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
                note_result(os.fstat(file.fileno()))
            if earlier is not None:
                earlier.unlink()

    def finish(self) -> None:
        """Give all files their names, also where the program is interrupted meanwhile."""
        if self.problem is not None:
            raise self.problem
        try:
            self._rename()
        except Exception:
            raise
        except BaseException:  # by a signal
            self._rename()
            raise

    def _rename(self) -> None:
        for path, temporary in list(self._written.items()):
            with self._reported(path):
                if temporary.exists():  # else an interrupted call has renamed it
                    os.replace(temporary, path)
            del self._written[path]

    def discard(self) -> None:
        """Delete what has not got its name."""
        for path in self._written.values():
            with suppress(OSError, ValueError):  # ValueError: a name with a null character
                path.unlink()
        for folder in sorted(self._folders, key=lambda each: -len(each.parts)):
            with suppress(OSError):  # another program has written into it
                folder.rmdir()

    @contextmanager
    def _reported(self, path: Path) -> Iterator[None]:
        try:
            yield
        except (OSError, ValueError) as problem:
            self.problem = not_written(path, problem)
            raise self.problem from None


_TOGETHER: ContextVar[_Files | None] = ContextVar("together", default=None)


@contextmanager
def together() -> Iterator[_Files]:
    """Within this context, `atomic_write` prepares files, which get their names at its end; after a failure none does.

    A failure is any exception that leaves the context, and a file that could not be written within it, even if that
    exception was caught. Contexts within each other are one.

    Raises:
        NotWritten: where a file could not be written.
    """
    outer = _TOGETHER.get()
    if outer is not None:
        yield outer
        return
    files = _Files()
    token = _TOGETHER.set(files)
    try:
        yield files
        files.finish()
    finally:
        _TOGETHER.reset(token)
        files.discard()


def write_several(write: Callable[..., object], *arguments: Iterable[Any]) -> None:
    """Call a function that writes a file for each of several arguments, at once: it mostly waits for the disk.

    Args:
        write: such as `atomic_write`.
        arguments: as for `map`.

    Raises:
        FormatError: where a file cannot be written; then none is.
    """
    with together(), ThreadPoolExecutor(AT_ONCE) as pool:
        written = [pool.submit(copy_context().run, write, *each) for each in zip(*arguments, strict=False)]
        for each in written:
            each.result()


def write_new(files: Mapping[str, str | bytes], folder: str | os.PathLike[str], *, force: bool = False) -> list[Path]:
    """Write files into a folder, all or none; those that exist are replaced with ``force`` only.

    Args:
        files: their contents by name.
        folder: where to.
        force: whether files that exist are replaced.

    Returns:
        Their paths.

    Raises:
        FormatError: where a file exists, or cannot be written.
    """
    paths = [Path(folder) / name for name in files]
    there = [path for path in paths if path.exists()]
    if there and not force:
        raise FormatError(f"{there[0]} exists; name another folder, or replace it", arguments=("force",))
    write_several(atomic_write, paths, files.values())
    return paths


def indented_json(content: Any) -> bytes:
    """A document as indented JSON."""
    return msgspec.json.format(msgspec.json.encode(content), indent=2) + b"\n"


def _reason(problem: Exception) -> str:
    return (getattr(problem, "strerror", None) or str(problem)).lower()


def _similar(path: Path) -> str:
    try:
        entries = sorted(path.parent.iterdir())
    except OSError:
        return f"; nor a folder {path.parent}" if not path.parent.is_dir() else ""
    stems = get_close_matches(path.stem, {entry.stem for entry in entries}, n=3, cutoff=0.6)
    close = [entry.name for stem in stems for entry in entries if entry.stem == stem][:3]  # suffixes are all alike
    return f"; did you mean {' or '.join(close)}?" if close else f" in {path.parent.resolve()}"


def packaged(package: str, name: str) -> Any:
    """The content of a JSON file that is part of a package."""
    return json.loads(files(package).joinpath(name).read_text(encoding="utf-8"))
