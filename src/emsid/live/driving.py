"""Drives a board with a test signal, within limits, and always ends at zero volts.

Commands follow the samples of the board, so that its clock sets the pace: after every piece of samples the voltage for
its time is sent. Before the signal the board is sampled at zero volts until its sample time is known. Whatever ends the
run – its end, a limit, Ctrl-C, an error, a connection that breaks – zero volts are sent, again over a new connection
where that is needed, and the samples are watched until they confirm it. A board must also set zero volts by itself
when commands cease (``docs/line-protocol.md``), for the case that this program or its machine is gone.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError
from emsid.estimation.nonlinear.control import FREE, Activity, Control
from emsid.live.protocol import LineParser
from emsid.live.receiver import Receiver
from emsid.live.sources import Disconnected
from emsid.live.timeline import Timeline

Array = NDArray[np.float64]

AGAIN = 0.1
"""Seconds after which the present command is sent again, so that the board does not stop."""
PATIENCE = 5.0
"""Seconds without a sample after which a run ends, unless others are given."""
CONFIRM = 2.0
"""Seconds to wait for a sample that confirms zero volts."""
EXCESS = 1.02
"""A voltage this many times larger than the limit, in the samples of the board, ends the run."""


@dataclass(frozen=True)
class Limits:
    """What ends a run.

    Args:
        voltage: the largest voltage in V; commands are refused above it.
        speed: the largest output in its unit; None for no limit.
        time: the longest run in s of wall time; None for no limit.

    Raises:
        DataError: for a limit that is not positive.
    """

    voltage: float
    speed: float | None = None
    time: float | None = None

    def __post_init__(self) -> None:
        for name in ("voltage", "speed", "time"):
            value = getattr(self, name)
            if value is not None and not (isfinite(value) and value > 0):
                raise DataError(f"{name} limit {value:g}; give a positive number")


@dataclass(eq=False)
class Drive:
    """The result of a run, which grows with its samples.

    Attributes:
        samples: received so far.
        commands: sent so far.
        dt: sample time of the board in s; None before it is known.
        reason: why it ended: ``done``, ``interrupted``, ``disconnected``, ``silent``, ``restarted`` (the time of the
            board stepped back), ``time``, ``voltage``, ``speed``.
        at_zero: whether samples have confirmed zero volts after the end; None where no sample came.
        largest: the largest output, by absolute value.
        largest_voltage: the largest voltage in the samples.
    """

    samples: int = 0
    commands: int = 0
    dt: float | None = None
    reason: str = ""
    at_zero: bool | None = None
    largest: float = 0.0
    largest_voltage: float = 0.0


def drive(
    receiver: Receiver,
    parser: LineParser,
    signal: Callable[[float], Array],
    limits: Limits,
    control: Control = FREE,
    dt: float | None = None,
    patience: float = PATIENCE,
) -> Drive:
    """Drive a board with a test signal.

    Args:
        receiver: the board.
        parser: of its lines.
        signal: the voltages (N,) for a sample time in s.
        limits: what ends the run.
        control: when to stop, and where to report progress.
        dt: sample time in s; by default from the samples.
        patience: seconds without a sample after which the run ends.

    Returns:
        What happened; ``at_zero`` says whether the board has confirmed zero volts.

    Raises:
        DataError: for a board that sends nothing, a source that takes no commands, or a signal above the limit.
    """
    run = _Run(receiver, parser, limits, Timeline(dt), patience)
    try:
        run.go(signal, control)
    finally:
        run.stop()
    return run.drive


class _Run:
    """The loop of `drive`."""

    def __init__(
        self, receiver: Receiver, parser: LineParser, limits: Limits, timeline: Timeline, patience: float
    ) -> None:
        self.receiver, self.parser, self.limits, self.timeline = receiver, parser, limits, timeline
        self.patience = patience
        self.drive = Drive()
        self.begun = self.heard = self.sent = time.monotonic()
        self.time, self.voltage = float("nan"), float("nan")

    def go(self, signal: Callable[[float], Array], control: Control) -> None:
        """Send the signal, sample by sample."""
        drive, command, voltages, first = self.drive, 0.0, None, 0.0
        self.receiver.send(b"?\n")
        self.command(command)
        while not drive.reason:
            if control.ending is not None:
                drive.reason = "interrupted"
                return
            if self.receive(0.02):
                if voltages is None and self.timeline.dt is not None:
                    drive.dt, first = self.timeline.dt, self.time
                    voltages = signal(self.timeline.dt)
                    self.check(voltages)
                if voltages is not None and drive.dt is not None:
                    k = round((self.time - first) / drive.dt)
                    control.report(Activity("driving the motor", max(k, 0), len(voltages)))
                    if k < -1:
                        drive.reason = "restarted"
                        return
                    if k >= len(voltages):
                        drive.reason = "done"
                        return
                    command = float(voltages[max(k, 0)])
                self.command(command)
            elif time.monotonic() - self.sent > AGAIN:
                self.command(command)
            self.watch()

    def check(self, voltages: Array) -> None:
        """Refuse a signal that is larger than the limit."""
        top = float(np.abs(voltages).max(initial=0.0))
        if not top <= self.limits.voltage:
            raise DataError(
                f"the signal reaches {top:g} V and the limit is {self.limits.voltage:g} V; lower its amplitude",
                arguments=("amplitude", "limit"),
            )

    def command(self, voltage: float) -> None:
        """Send a voltage."""
        try:
            self.receiver.send(b"u %.6g\n" % voltage)
        except Disconnected:
            self.drive.reason = self.drive.reason or "disconnected"
        self.sent = time.monotonic()
        self.drive.commands += 1

    def receive(self, timeout: float) -> bool:
        """Read what has arrived; whether it has samples."""
        drive, some = self.drive, False
        for piece in self.receiver.wait(timeout):
            if piece.kind == "failed":
                raise DataError(piece.text)
            if piece.kind in ("disconnected", "ended"):
                self.timeline.cut("disconnected")
                drive.reason = drive.reason or "disconnected"
            rows = self.parser.feed(piece.data) if piece.data else None
            if rows is None:
                continue
            some, self.heard = True, time.monotonic()
            drive.samples += len(rows)
            self.timeline.place(rows)
            clock = self.timeline.time
            self.time = clock if clock is not None and isfinite(clock) else drive.samples * (self.timeline.dt or 0.0)
            self.voltage = float(rows.input[-1, 0])
            drive.largest = max(drive.largest, float(np.abs(rows.output).max()))
            drive.largest_voltage = max(drive.largest_voltage, float(np.abs(rows.input[:, 0]).max()))
        return some

    def watch(self) -> None:
        """End the run where a limit is passed."""
        drive, limits, now = self.drive, self.limits, time.monotonic()
        if drive.largest_voltage > EXCESS * limits.voltage:
            drive.reason = "voltage"
        elif limits.speed is not None and drive.largest > limits.speed:
            drive.reason = "speed"
        elif limits.time is not None and now - self.begun > limits.time:
            drive.reason = "time"
        elif now - self.heard > self.patience and not drive.reason:
            if not drive.samples:
                raise DataError(
                    f"{self.receiver.source.name} has sent no sample for {self.patience:g} s; check that the board "
                    "runs, the baud rate, and its header"
                )
            drive.reason = "silent"

    def stop(self) -> None:
        """Send zero volts until samples confirm them, for a moment also over a connection that comes back."""
        end, drive = time.monotonic() + CONFIRM, self.drive
        self.voltage = float("nan")
        while time.monotonic() < end and not drive.at_zero:
            try:
                self.receiver.send(b"u 0\n")
            except (Disconnected, DataError, OSError):
                time.sleep(AGAIN)
            try:
                if self.receive(AGAIN):
                    drive.at_zero = abs(self.voltage) <= 1e-9
            except DataError:
                return
