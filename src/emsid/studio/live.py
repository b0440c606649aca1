"""Live: a running source, followed by the command line in a process of its own."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from threading import Thread
from typing import Any

import msgspec

from emsid.errors import DataError
from emsid.findings import Finding
from emsid.studio.session import Session
from emsid.studio.words import field_name, in_page
from emsid.wording import sentence


def worded(message: dict[str, Any]) -> dict[str, Any]:
    """A message of a tracking, where it is a finding with its sentence."""
    if message["kind"] != "finding":
        return message
    found = {name: message[name] for name in ("code", "subject", "data")}
    return {**message, "text": sentence(Finding(**found), field_name)}


@dataclass
class Live:
    """The tracking of a source; one at a time.

    Args:
        session: its folder gets what the tracking writes.
        announce: called with every message of it.
        program: the words of the program that follows a source, from what was asked and a folder.
    """

    session: Session
    announce: Callable[[dict[str, Any]], None]
    program: Callable[[Mapping[str, Any], Path], list[str]]
    process: subprocess.Popen[str] | None = field(default=None)
    problem: str = ""

    @property
    def state(self) -> dict[str, Any]:
        """Whether a source is followed, and what went wrong."""
        return {"running": self.process is not None and self.process.poll() is None, "problem": self.problem}

    def begin(self, asked: Mapping[str, Any]) -> None:
        """Follow a source.

        Raises:
            DataError: where one is followed already, or none is named.
        """
        if self.state["running"]:
            raise DataError("a source is followed already; stop it first")
        if not str(asked.get("source", "")).strip():
            raise DataError("name a source: a file, serial:///dev/ttyACM0 or socket://host:port")
        number = len(list(self.session.folder.glob("live-*"))) + 1
        words = self.program(asked, self.session.folder / f"live-{number}")
        self.problem = ""
        self.process = subprocess.Popen(
            words, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8"
        )
        Thread(target=self._follow, args=(self.process,), daemon=True).start()

    def _follow(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        assert process.stderr is not None
        with process:
            for line in process.stdout:
                with suppress(msgspec.DecodeError):
                    self.announce({"kind": "live", "message": worded(msgspec.json.decode(line))})
            said = process.stderr.read().strip()
        self.problem = in_page(said, self.session.folder) if process.returncode > 0 else ""
        self.announce({"kind": "live", "message": {"kind": "ended", "problem": self.problem}})

    def stop(self) -> None:
        """End the tracking; it writes its record and report."""
        if self.process is not None and self.process.poll() is None:
            self.process.terminate()
