"""Runs: one process for each identification, its progress, and what it left."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from threading import RLock, Thread
from typing import Any

import msgspec

from emsid.errors import FormatError
from emsid.io import atomic_write
from emsid.studio.session import Session

AT_ONCE = 2
"""Runs at the same time; further ones wait. Each uses a core."""
MOST_POINTS = 200
"""Points of the progress of a search."""
FILES = frozenset({"task.json", "result.json", "problem.json", "shown.json", "best.json"})
"""Files of a run that are no models of its own."""


def _follow_search(search: dict[str, list[list[float]]], message: Mapping[str, Any]) -> None:
    """Add the time and the lowest cost so far to what is known of the search for a model; every other one is dropped
    where there are many."""
    if message.get("cost") is None:
        return
    points = search.setdefault(message["doing"].partition(":")[0], [])
    points.append([message["seconds"], min(message["cost"], *(points[-1][1:] if points else ()), message["cost"])])
    if len(points) > MOST_POINTS:
        del points[1:-1:2]


class Runs:
    """The runs of a session.

    Args:
        session: where they are.
        announce: called with every message, also from other threads.
    """

    def __init__(self, session: Session, announce: Callable[[dict[str, Any]], None]) -> None:
        self.session, self.announce = session, announce
        self._processes: dict[str, subprocess.Popen[str] | None] = {}
        self._progress: dict[str, dict[str, Any]] = {}
        self._problems: dict[str, str] = {}
        self._waiting: list[str] = []
        self._lock = RLock()

    def begin(self, task: Mapping[str, Any]) -> str:
        """Start an identification, or put it into the queue; the number of the run."""
        with self._lock:  # it has no state before it waits
            folder = self.session.new_folder("runs")
            try:
                atomic_write(folder / "task.json", msgspec.json.encode(task))
            except FormatError:
                folder.rmdir()
                raise
            self._waiting.append(folder.name)
        self._next()
        return folder.name

    def cancel(self, number: str) -> None:
        """End a run with what it has; a second time, end its process at once."""
        with self._lock:
            if number in self._waiting:
                self._waiting.remove(number)
                return
            if number not in self._processes:
                return
            process = self._processes[number]
            known = self._progress.setdefault(number, {"fits": {}, "search": {}})
            if process is not None:
                if known.get("ending"):
                    process.kill()
                self._end(process)
            known["ending"] = True  # a process that is being started is told once it is there
        self.announce({"kind": "run", "run": self.state(number)})

    @staticmethod
    def _end(process: subprocess.Popen[str]) -> None:
        """Tell a process to end with what it has."""
        assert process.stdin is not None
        with suppress(OSError):  # it has ended
            process.stdin.close()

    def close(self) -> None:
        """End all processes."""
        with self._lock:
            self._waiting.clear()
            for process in self._processes.values():
                if process is not None:
                    process.terminate()

    def _next(self) -> None:
        with self._lock:
            while self._waiting and len(self._processes) < AT_ONCE:
                number = self._waiting.pop(0)
                self._processes[number] = None
                Thread(target=self._follow, args=(number,), daemon=True).start()

    def _follow(self, number: str) -> None:
        """Run the process of a run and pass on what it reports."""
        folder = self.session.folder / "runs" / number
        program = [sys.executable, "-m", "emsid.studio.worker", str(self.session.folder), str(folder)]
        with (
            (folder / "log.txt").open("w") as log,
            subprocess.Popen(
                program, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, text=True, encoding="utf-8"
            ) as process,
        ):
            with self._lock:
                self._processes[number] = process
                if self._progress.get(number, {}).get("ending"):
                    self._end(process)
            assert process.stdout is not None
            for line in process.stdout:
                message = msgspec.json.decode(line)
                with self._lock:
                    known = self._progress.setdefault(number, {"fits": {}, "search": {}})
                    if message["kind"] == "progress":
                        known["progress"] = message
                        _follow_search(known["search"], message)
                    elif message["kind"] == "fit":
                        known["fits"][message["model"]] = message["fit"]
                    elif message["kind"] == "failed":
                        self._problems[number] = message["message"]
                self.announce({"kind": "run", "run": self.state(number)})
        with self._lock:
            del self._processes[number]
            self._progress.pop(number, None)
        self.announce({"kind": "run", "run": self.state(number)})
        self._next()

    def state(self, number: str) -> dict[str, Any]:
        """What a run is doing, or what it left."""
        folder = self.session.folder / "runs" / number
        with self._lock:
            running, waiting = number in self._processes, number in self._waiting
            known = dict(self._progress.get(number, {}))
        models = sorted(path.stem for path in folder.glob("*.json") if path.name not in FILES)
        found: dict[str, Any] = {"number": number, "models": models, **known}
        task = folder / "task.json"
        found["task"] = msgspec.json.decode(task.read_bytes()) if task.exists() else {}
        if running or waiting:
            found["state"] = "running" if running else "waiting"
        elif (folder / "shown.json").exists():
            found["state"] = "done"
        elif (folder / "problem.json").exists():
            found |= {"state": "failed", **msgspec.json.decode((folder / "problem.json").read_bytes())}
        elif number in self._problems:  # which could not be written
            found |= {"state": "failed", "message": self._problems[number]}
        else:
            found |= {"state": "ended", "message": "it ended before its result was complete; the models found are kept"}
        return found

    @property
    def states(self) -> list[dict[str, Any]]:
        """All runs, the last one first."""
        return [self.state(folder.name) for folder in reversed(self.session.runs)]

    def folder(self, number: str) -> Path | None:
        """The folder of a run; None for a number of none."""
        return next((path for path in self.session.runs if path.name == number), None)
