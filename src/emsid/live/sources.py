"""Sources of samples: a file, standard input, a serial port, a socket.

==========================  ===========================================================================================
``log.csv``                 a file
``-``                       lines on standard input
``serial:///dev/ttyACM0``   a serial port, also ``serial://COM3`` or the path of the device alone
``socket://host:7000``      a TCP port
``rfc2217://host:7000``     a serial port that another machine serves
``loop://``                 a port that sends back what is written to it, for tests
==========================  ===========================================================================================

Other kinds of URLs that pyserial knows are refused: ``spy://`` writes files. Samples of a source, or of the log of one,
become a record.
"""

from __future__ import annotations

import os
import select
import socket
import stat
import time
from collections.abc import Callable
from contextlib import suppress
from math import inf
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import urlsplit

from emsid.errors import DataError
from emsid.live.log import read_from
from emsid.live.protocol import Columns, LineParser
from emsid.live.timeline import Stretch, Timeline
from emsid.record import Record, concatenate
from emsid.replacing import note_source

CHUNK = 1 << 16
"""Bytes that are read at a time."""
CONNECTING, SENDING = 5.0, 1.0
"""Seconds in which a host has to answer, and in which a connection has to take a command."""
AGAIN = 0.1
"""Seconds between two attempts to open a port that nothing serves yet: ten a second load no machine."""


class Ended(Exception):
    """A source has no more samples: the end of a file, or a closed pipe."""


class Disconnected(Exception):
    """A connection broke; it may come back."""


class NotServed(DataError):
    """Nothing listens at a port; a board or a server that starts may do so soon."""


class Source(Protocol):
    """Something that sends lines.

    Attributes:
        name: for messages.
        lasting: whether the bytes stay where they are, so that they need no log, and may wait.
    """

    name: str
    lasting: bool

    def read(self, timeout: float) -> bytes:
        """The bytes that have arrived, after at most this many seconds; empty where none have.

        Raises:
            Ended: at the end of a file or pipe.
            Disconnected: where a connection broke.
        """
        ...

    def write(self, data: bytes) -> None:
        """Send bytes to the board.

        Raises:
            Disconnected: where a connection broke.
            DataError: for a source that takes no commands.
        """
        ...

    def close(self) -> None:
        """Close it."""
        ...


def is_connection(text: str) -> bool:
    """Whether a source is a connection, which can break and come back, and not a file or standard input."""
    return text != "-" and ("://" in text or _is_device(text))


def open_source(text: str, baud: int = 115200) -> Source:
    """Open a source.

    Args:
        text: see the table above.
        baud: of a serial port, in bits per second.

    Raises:
        DataError: where it cannot be opened, with the reason and what to do.
    """
    if text == "-":
        return Descriptor(0, "standard input")
    if is_connection(text):
        return TcpPort(text) if _kind(text) == "socket" else SerialPort(text, baud)
    try:
        # Without O_NONBLOCK, a named pipe is opened only when another program opens it for writing.
        descriptor = os.open(text, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
        return Descriptor(descriptor, text, lasting=not stat.S_ISFIFO(os.fstat(descriptor).st_mode))
    except IsADirectoryError:
        reason = "this is a folder; name a file in it"
    except FileNotFoundError:
        reason = "there is no such file; name a file, -, serial://… or socket://…"
    except OSError as problem:
        reason = f"cannot be read ({(problem.strerror or str(problem)).lower()}); check its permissions"
    raise DataError(f"{text}: {reason}")


def awaited(opening: Callable[[], Source], seconds: float | None, notify: Callable[[str], None]) -> Source:
    """Open a source; where nothing serves its port yet, try again, so that it may start after this program.

    Args:
        opening: opens it.
        seconds: for which to try; 0 for one attempt, None to try until it is served.
        notify: shows that it waits.

    Raises:
        NotServed: where nothing serves the port after this time.
        DataError: where it cannot be opened for another reason, at once.
    """
    until, waits = inf if seconds is None else time.monotonic() + seconds, False
    while True:
        try:
            return opening()
        except NotServed as problem:
            if time.monotonic() >= until:
                raise
            if not waits:
                notify(f"{problem}; waiting {'' if seconds is None else f'{seconds:g} s '}for it")
            waits = True
        time.sleep(AGAIN)


def connect(text: str, baud: int = 115200) -> Source:
    """Open a connection, and ask the board for its header: what came before the opening is lost.

    Args:
        text, baud: as in `open_source`.

    Raises:
        DataError: where it cannot be opened, with the reason and what to do.
    """
    source = open_source(text, baud)
    with suppress(Disconnected):  # it is opened again, and asked then
        source.write(b"?\n")
    return source


class Descriptor:
    """A file or a pipe that is only read.

    Args:
        descriptor: of the open file.
        name: for messages.
        lasting: whether its bytes stay where they are.
    """

    def __init__(self, descriptor: int, name: str, lasting: bool = False) -> None:
        self._descriptor, self.name, self.lasting = descriptor, name, lasting
        status = os.fstat(descriptor)
        note_source(status)
        if lasting and stat.S_ISDIR(status.st_mode):
            os.close(descriptor)
            raise DataError(f"{name}: this is a folder; name a file in it")

    def read(self, timeout: float) -> bytes:
        """See `Source.read`."""
        if not self.lasting and not select.select([self._descriptor], [], [], timeout)[0]:
            return b""
        data = os.read(self._descriptor, CHUNK)
        if not data:
            raise Ended
        return data

    def write(self, data: bytes) -> None:
        """Refuse: a file takes no commands."""
        raise DataError(f"{self.name} takes no commands; name a serial port or a socket")

    def close(self) -> None:
        """Close it, unless it is standard input."""
        if self._descriptor:
            os.close(self._descriptor)


class TcpPort:
    """A connection to a TCP port. pyserial is not used: it throws away what arrives while it opens a socket.

    Args:
        text: its URL.

    Raises:
        DataError: where it cannot be opened, with the reason and what to do.
    """

    lasting = False

    def __init__(self, text: str) -> None:
        self.name = text
        try:
            self._socket = socket.create_connection(_address(text), CONNECTING)
        except OSError as problem:
            raise _unopened(text, problem) from None
        self._socket.settimeout(SENDING)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def read(self, timeout: float) -> bytes:
        """See `Source.read`."""
        try:
            if not select.select([self._socket], [], [], timeout)[0]:
                return b""
            data = self._socket.recv(CHUNK)
        except (OSError, ValueError) as problem:  # ValueError: it was closed meanwhile
            raise Disconnected(str(problem)) from None
        if not data:
            raise Disconnected("the other side has closed the connection")
        return data

    def write(self, data: bytes) -> None:
        """See `Source.write`."""
        try:
            self._socket.sendall(data)
        except OSError as problem:
            raise Disconnected(str(problem)) from None

    def close(self) -> None:
        """Close it."""
        with suppress(OSError):
            self._socket.close()


class SerialPort:
    """A serial port of this machine or another one, by pyserial.

    Args:
        text: its URL or device.
        baud: in bits per second.

    Raises:
        DataError: where it cannot be opened, with the reason and what to do.
    """

    lasting = False

    def __init__(self, text: str, baud: int) -> None:
        import serial

        self.name, self._lost = text, (serial.SerialException, OSError)
        url = text.partition("://")[2] if "://" in text and _kind(text) == "serial" else text
        if _kind(text) == "rfc2217":
            _address(text)
        elif _kind(text) != "loop" and (not url or "://" in url):
            raise DataError(f"{text}: {KINDS}")
        try:
            options: dict[str, Any] = {} if url.startswith("rfc2217:") else {"write_timeout": 1.0}
            if "://" not in url and os.name == "posix":
                options["exclusive"] = True
            self._port: Any = serial.serial_for_url(url, baudrate=baud, timeout=0, **options)
        except (ValueError, OSError) as problem:  # SerialException is an OSError
            raise _unopened(text, problem) from None
        try:
            self._number: int | None = self._port.fileno()
        except Exception:  # loop:// and rfc2217:// have none
            self._number = None
            self._port.timeout = 0.05

    def read(self, timeout: float) -> bytes:
        """See `Source.read`."""
        try:
            if self._number is not None:
                if not select.select([self._number], [], [], timeout)[0]:
                    return b""
                return bytes(self._port.read(CHUNK))
            return bytes(self._port.read(max(1, self._port.in_waiting)))
        except (*self._lost, TypeError, AttributeError) as problem:  # the last two: the port was closed meanwhile
            raise Disconnected(str(problem)) from None

    def write(self, data: bytes) -> None:
        """See `Source.write`."""
        try:
            self._port.write(data)
        except (*self._lost, TypeError, AttributeError) as problem:
            raise Disconnected(str(problem)) from None

    def close(self) -> None:
        """Close it."""
        with suppress(Exception):
            self._port.close()


KINDS = "no such kind of source; there are serial:///dev/ttyACM0, socket://host:7000, rfc2217://host:7000 and loop://"
"""The advice about an unknown URL."""


def _kind(text: str) -> str:
    """The kind of a URL, ``serial`` for the path of a device.

    Raises:
        DataError: for a kind that is not known.
    """
    kind = text.partition("://")[0].lower() if "://" in text else "serial"
    if kind not in ("serial", "socket", "rfc2217", "loop"):
        raise DataError(f"{text}: {KINDS}")
    return kind


def _address(text: str) -> tuple[str, int]:
    """Host and port of a URL.

    Raises:
        DataError: where one is missing, or no port has that number.
    """
    try:
        parts = urlsplit(text)
        host = parts.hostname
    except ValueError:
        host = None
    if not host:
        raise DataError(f"{text}: the host is missing; write {_kind(text)}://host:port, as in socket://localhost:7000")
    _, colon, number = parts.netloc.rpartition("@")[2].rpartition("]")[2].rpartition(":")
    number = number if colon else ""
    shown = repr(number) if number else "nothing"
    if not (number.isascii() and number.isdigit() and len(number) <= 5 and 0 < int(number) < 2**16):
        raise DataError(f"{text}: {shown} is no port; write a number from 1 to 65535 after the host")
    return host, int(number)


def _is_device(text: str) -> bool:
    """Whether this is the device of a serial port."""
    if os.name != "posix":
        return text.upper().startswith("COM") and text[3:].isdigit()
    with suppress(OSError, ValueError):
        return stat.S_ISCHR(Path(text).stat().st_mode)
    return text.startswith("/dev/tty")


def _unopened(text: str, problem: Exception) -> DataError:
    """The error for a port that cannot be opened."""
    if "refused" in str(problem).lower():
        return NotServed(f"{text}: nothing listens there; start the board or the server, or check the port number")
    return DataError(f"{text}: {_advice(problem)}")


def _advice(problem: Exception) -> str:
    """Why a port cannot be opened, and what to do."""
    text = str(problem).lower()
    number = getattr(problem, "errno", None)
    if "exclusive" in text or "busy" in text or number in (11, 16):
        return "the port is used by another program; close that (a serial monitor?)"
    if "permission" in text or number == 13:
        return "no permission to open the port; on Linux, join its group (often dialout) and log in again"
    if "no such file" in text or "not exist" in text or number == 2:
        return "there is no such port; plug the board in, or check its name"
    if "name or service" in text or "getaddrinfo" in text or "temporary failure" in text or "no address" in text:
        return "the host is not known; check its name"
    if "timed out" in text or "unreachable" in text or "no route" in text:
        return "the host does not answer; check the address and the network"
    if "rfc2217" in text and "remote" in text:
        return "nothing there speaks RFC 2217; for a plain connection, write socket://"
    reason = os.strerror(number).lower() if isinstance(number, int) and number > 0 else "the port does not work"
    return f"it cannot be opened ({reason}); check that it is a serial port, its name and its settings"


def record_of(
    stretch: Stretch, channels: tuple[tuple[str, ...], str, tuple[str, ...], str], dt: float, name: str
) -> Record:
    """A stretch of samples as a record."""
    inputs, output, input_units, output_unit = channels
    units = (input_units, (output_unit,))
    return Record(stretch.input, stretch.output, dt, inputs, (output,), *units, times=(stretch.time,), name=name)


def read_log(
    path: str | Path,
    begin: int = 0,
    header: str = "",
    inputs: tuple[str, ...] = (),
    output: str = "",
    time: str = "",
    dt: float | None = None,
    whole: bool = False,
    columns: Columns | None = None,
) -> Record:
    """The samples of a log as a record, with a segment for every stretch without a gap.

    Args:
        path: of the log, or of any file of lines.
        begin: the byte to begin at.
        header: the columns, where the file has no header.
        inputs, output, time: names of the columns.
        dt: sample time in s; by default from the time column.
        whole: whether a last line without its line break is complete; in a log it may be cut off.
        columns: what the columns are, where that is known already.

    Raises:
        FormatError: where the file cannot be read.
        DataError: where it has no samples.
    """
    parser, timeline = LineParser(header, inputs, output, time, columns=columns), Timeline(dt)
    data = read_from(path, begin)
    rows = parser.feed(data + b"\n" if whole else data[: data.rfind(b"\n") + 1])
    if parser.columns is None and parser.problem is not None:
        raise parser.problem
    if rows is None or parser.columns is None:
        raise DataError(f"{path}: there are no samples in this log")
    stretches = timeline.place(rows, last=True)
    if timeline.dt is None or not stretches:
        raise DataError(f"{path}: there are too few samples in this log to find its sample time", arguments=("dt",))
    step = timeline.dt
    records = [record_of(stretch, parser.columns.channels, step, Path(path).name) for stretch in stretches]
    return concatenate(records)
