"""An append-only log of everything that a source sends.

Bytes are written as they arrive, and forced to the disk every `SYNC` seconds: whatever ends the program, at most that
much is lost, and of the last line perhaps a part. Where others follow, a line that was cut off ends with ``~``, so that
it is not taken for a sample. Lines of the program itself begin with ``#``: where a connection began, broke, came back.
So the log can be read, and tracked, like any other source.

On a full disk the bytes are kept in memory and written again later; at the end, what is left goes to the folder of
temporary files.
"""

from __future__ import annotations

import errno
import os
import sys
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from tempfile import NamedTemporaryFile
from threading import Event, Thread
from threading import Lock as ThreadLock

from emsid.errors import FormatError

SYNC = 0.5
"""Seconds between two moments at which everything is forced to the disk."""
MOST_PENDING = 1 << 28
"""Bytes that are kept in memory while the disk does not take them."""


class Log:
    """An append-only file of received lines.

    Attributes:
        path: the file.
        begin: its length before this program wrote to it.
        problem: why bytes wait to be written; empty where none do.

    Args:
        path: the file; it is made where it is missing.

    Raises:
        FormatError: where it cannot be opened.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path, self.problem = Path(path), ""
        self._pending, self._lock, self._ended = bytearray(), ThreadLock(), Event()
        self._in_line = False
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._held = Lock(self.path.with_name(f".{self.path.name}.lock"))
            self._file = os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
            self.begin = os.fstat(self._file).st_size
        except Taken as other:
            raise FormatError(
                f"{self.path}: {other.by} writes into this log; end it, or choose another place", arguments=("out",)
            ) from None
        except OSError as problem:
            raise FormatError(
                f"{self.path}: the log cannot be written ({_reason(problem)}); choose another place", arguments=("out",)
            ) from None
        self._syncing = Thread(target=self._sync_often, name="log", daemon=True)
        self._syncing.start()
        self._in_line = self.begin > 0 and read_from(self.path, self.begin - 1) != b"\n"
        self.mark("begins")

    @property
    def pending(self) -> int:
        """Bytes that are not written yet."""
        return len(self._pending)

    def write(self, data: bytes) -> None:
        """Append bytes as they were received.

        Raises:
            FormatError: where the disk takes no more and too much waits.
        """
        with self._lock:
            if data:
                self._pending += data
                self._in_line = data[-1:] != b"\n"
            self._drain()
        if len(self._pending) > MOST_PENDING:
            raise FormatError(f"{self.path}: the log cannot be written ({self.problem}); free space on the disk")

    def mark(self, what: str) -> None:
        """Append a line of the program, with the date; an incomplete line before it gets a ``~``."""
        start = b"~\n" if self._in_line else b""
        self.write(start + f"# emsid: {what} at {datetime.now(UTC).isoformat(timespec='milliseconds')}\n".encode())

    def close(self) -> None:
        """Write what waits, force it to the disk, and close the file.

        Raises:
            FormatError: where something could not be written.
        """
        self._ended.set()
        self._syncing.join()
        with self._lock:
            self._drain()
            with suppress(OSError):
                os.fsync(self._file)
            os.close(self._file)
            self._held.release()
        if self._pending:
            lines = self._pending.count(b"\n")
            raise FormatError(
                f"{self.path}: the last {lines} lines could not be written ({self.problem}); {self._rescued()}"
            )

    def _rescued(self) -> str:
        """Write what waits to the folder of temporary files, and say what to do."""
        try:
            with NamedTemporaryFile(prefix="emsid-log-", suffix=".txt", delete=False) as file:
                file.write(self._pending)
        except OSError:
            return "free space on the disk"
        return f"they are in {file.name}: free space on the disk, and append them"

    def _drain(self) -> None:
        """Write what waits, as far as the disk takes it."""
        try:
            while self._pending:
                done = os.write(self._file, self._pending)
                del self._pending[:done]
            self.problem = ""
        except OSError as problem:
            self.problem = _reason(problem)

    def _sync_often(self) -> None:
        while not self._ended.wait(SYNC):
            with self._lock:
                if self._pending:
                    self._drain()
            with suppress(OSError):  # a pipe or a terminal cannot be forced to the disk
                os.fsync(self._file)


class Taken(Exception):
    """Another process holds a lock.

    Args:
        by: its name, with its number where that is known.
    """

    def __init__(self, by: str) -> None:
        self.by = by


class Lock:
    """A file with the number of the process that holds it, which the system gives free when that process ends.

    So the file that a killed process has left is no obstacle.

    Args:
        path: the file.

    Raises:
        Taken: where another process holds it.
        OSError: where it cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        while True:
            self._file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
            if not _locked(self._file):
                number = os.read(self._file, 20).decode("ascii", "replace").strip()
                os.close(self._file)
                raise Taken(f"another process{f' (number {number})' if number.isdigit() else ''}")
            with suppress(OSError):
                if os.path.samestat(os.fstat(self._file), os.stat(path)):
                    break
            os.close(self._file)  # its holder has deleted it meanwhile
        os.truncate(self._file, 0)
        os.write(self._file, b"%d\n" % os.getpid())

    def release(self) -> None:
        """Delete the file, and let others have it."""
        with suppress(OSError):
            self._path.unlink()
        os.close(self._file)


def _locked(file: int) -> bool:
    """Lock an open file; false if another process has done so, true also where the disk knows no locks."""
    try:
        if sys.platform == "win32":
            import msvcrt

            os.lseek(file, 1 << 20, os.SEEK_SET)  # beyond the number, which others read
            msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
            os.lseek(file, 0, os.SEEK_SET)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as problem:
        return problem.errno not in (errno.EACCES, errno.EAGAIN, errno.EDEADLK)
    return True


def read_from(path: str | os.PathLike[str], begin: int = 0) -> bytes:
    """The bytes of a log from this place on.

    Raises:
        FormatError: where it cannot be read.
    """
    try:
        with open(path, "rb") as file:
            file.seek(begin)
            return file.read()
    except OSError as problem:
        raise FormatError(f"{path}: the log cannot be read ({_reason(problem)})") from None


def _reason(problem: OSError) -> str:
    return (problem.strerror or str(problem)).lower()
