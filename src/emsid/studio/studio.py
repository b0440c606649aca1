"""What the page can do: change the step, add files, fit, and the state that every page shows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from threading import RLock
from typing import TYPE_CHECKING, Any

from emsid.errors import DataError, EmsidError
from emsid.studio.data import Data
from emsid.studio.script import as_script
from emsid.studio.session import EMPTY, Conflict, Session

if TYPE_CHECKING:
    from pathlib import Path

    from emsid.studio.live import Live
    from emsid.studio.runs import Runs

COUNTS = ("na", "nb", "nk", "degree", "taps", "knots", "period", "bootstrap", "seed")
NUMBERS = ("ridge", "forgetting", "recent")
TEXTS = ("static", "hold")
NO_RECORD = frozenset({"not-readable", "no-role-found"})
"""Findings that say why there is no record."""
LISTS = ("free", "per_record", "profile")
UNITS = (
    "V",
    "A",
    "N",
    "N*m",
    "m",
    "mm",
    "um",
    "m/s",
    "mm/s",
    "rad",
    "deg",
    "rad/s",
    "deg/s",
    "rpm",
    "count",
    "count/sample",
    "pwm",
    "%",
)
"""Units that are offered; any other can be typed."""


@dataclass
class Studio:
    """A session with its data and runs.

    Args:
        session, runs, live: of it.
        spelling: how names of arguments are written in findings.
        command: a task as a command line.
        announce: called when the state has changed.
    """

    session: Session
    runs: Runs
    live: Live
    spelling: Callable[[str], str]
    command: Callable[[Mapping[str, Any], Path], str]
    announce: Callable[[dict[str, Any]], None] = lambda message: None
    data: Data = field(init=False)
    _adding: Any = field(default_factory=RLock, init=False)

    def __post_init__(self) -> None:
        self.data = Data(self.session, self.spelling)

    def warm(self) -> None:
        """Load what the first fit and the first free run need."""
        from emsid.estimation.linear.filtering import filtered

        with suppress(EmsidError):
            filtered([1.0], [1.0], [1.0])
            self.state()

    def change(self, on: int, step: Mapping[str, Any], **values: Any) -> dict[str, int]:
        """Take another step, if its data can be read.

        Args:
            on: the version that the change is made on.
            step: of this version.
            values: that change.

        Returns:
            The version that it makes.

        Raises:
            Conflict: where the session has changed since, also while the data were read.
            EmsidError: where they cannot be read.
        """
        step = {**step, **values}
        looked_at = step["files"] and values.keys() & {"files", "given", "unseen_files"}
        if looked_at and self.data.look(step).record is None and step["given"]:
            found = self.data.described(step)
            said = [each["text"] for each in found["findings"] if each["code"] in NO_RECORD]
            raise DataError(said[0] if said else "no record can be read like this")
        self.session.change(on, **values)
        self.announce({"kind": "state"})
        return {"version": on + 1}

    def add(self, name: str, *, unseen: bool = False) -> None:
        """Add a file of the session to the data; the first one is looked at anew.

        Raises:
            EmsidError: where it cannot be read.
        """
        self.data.parsed(name)
        with self._adding:
            while True:  # unlike other changes, those that add a file do not exclude each other
                on, step = self.session.present
                key = "unseen_files" if unseen and step["files"] else "files"
                values: dict[str, Any] = {key: [*step[key], name]} | ({} if step["files"] else {"given": {}})
                with suppress(Conflict):
                    self.change(on, step, **values)
                    return

    def _made_on(self, version: Any) -> tuple[int, dict[str, Any]]:
        """The present version and its step.

        Raises:
            Conflict: where a request was made on another version.
        """
        on, step = self.session.present
        if version is not None and int(version) != on:
            raise Conflict
        return on, step

    def edit(self, content: Mapping[str, Any], version: Any = None) -> dict[str, int]:
        """Change parts of the step; ``given`` is merged, and a None in it takes back a correction.

        Raises:
            DataError: for a part that is none.
            EmsidError: where the data cannot be read like this.
        """
        (on, step), values = self._made_on(version), dict(content)
        unknown = values.keys() - EMPTY.keys()
        if unknown:
            raise DataError(f"there is no {', '.join(sorted(unknown))} in a step")
        known = {*step["files"], *step["unseen_files"]}
        for key in ("files", "unseen_files"):
            if not set(values.get(key, [])) <= known:
                raise DataError("there is no such file")
        if "given" in values:
            merged = {**step["given"], **values["given"]}
            values["given"] = {name: value for name, value in merged.items() if value is not None}
        if "options" in values:
            values["options"] = options_of(values["options"])
        if "unseen" in values and not 0 < float(values["unseen"]) < 1:
            raise DataError("the unseen part is a fraction between 0 and 1")
        if "models" in values:
            from emsid.identification.requests import model_names

            values["models"] = list(model_names(values["models"])) if values["models"] else []
        if not values.get("files", [""]):
            values |= {"given": {}, "unseen_files": []}
        return self.change(on, step, **values)

    def move(self, by: int, version: Any = None) -> dict[str, int]:
        """Undo or redo."""
        on, _ = self._made_on(version)
        self.session.move(on, by)
        self.announce({"kind": "state"})
        return {"version": on + 1}

    def brush(self, content: Mapping[str, Any], version: Any = None) -> dict[str, int]:
        """Leave out what lies between two times (``mask``), keep only that (``cut``), or fit up to there (``split``).

        Raises:
            DataError: for another kind, or times without samples.
        """
        kind, (on, step) = content["kind"], self._made_on(version)
        name, first, last = str(content["file"]), float(content["first"]), float(content["last"])
        if kind == "split":
            record = self.data.record(step, name)
            after = float((record.time >= first).mean())
            return self.edit({"unseen": float(f"{after:.10g}")}, on)
        a, b = self.data.rows(step, name, first, last)
        given = dict(step["given"])
        if kind == "mask":
            before = self.data.reading(step).get("mask")
            new = f"row >= {a} AND row < {b}"
            given["mask"] = f"({before}) OR ({new})" if before else new
        elif kind == "cut":
            given["rows"] = [a, b]
        else:
            raise DataError("a brush can mask, cut or split")
        return self.change(on, step, given=given)

    def example(self, name: str, version: Any = None) -> dict[str, int]:
        """Begin with an example of `emsid demo`.

        Raises:
            DataError: for another name.
        """
        from emsid.io import write_record
        from emsid.study.demonstration import EXAMPLES

        on, step = self._made_on(version)
        found = next((each for each in EXAMPLES if each.name == name), None)
        if found is None:
            raise DataError("there is no such example")
        file = self.session.free_name(f"{name}.csv")
        write_record(found.record(), self.session.path(file))
        return self.change(on, step, files=[file], unseen_files=[], given={})

    @property
    def task(self) -> dict[str, Any]:
        """What a run of the present step is asked."""
        return self._task_of(self.session.step)

    def _task_of(self, step: Mapping[str, Any]) -> dict[str, Any]:
        if not step["files"]:
            raise DataError("there are no data; drop a file or choose an example")
        names = ("files", "unseen_files", "unseen", "models", "options")
        return {name: step[name] for name in names} | {"reading": self.data.reading(step)}

    def run(self, version: Any = None) -> dict[str, str]:
        """Fit; the number of the run."""
        number = self.runs.begin(self._task_of(self._made_on(version)[1]))
        self.announce({"kind": "run", "run": self.runs.state(number)})
        return {"run": number}

    def state(self) -> dict[str, Any]:
        """Everything that the page shows."""
        version, step = self.session.present
        found: dict[str, Any] = {
            "step": step,
            "version": version,
            "undo": self.session.at > 0,
            "redo": self.session.at < len(self.session.steps) - 1,
            "folder": str(self.session.folder),
            "catalogue": catalogue(),
            "runs": self.runs.states,
            "units": UNITS,
            "live": self.live.state,
        }
        try:
            found["data"] = self.data.described(step)
            if step["files"]:
                found["command"] = self.command(self.task, self.session.folder / "data")
                found["script"] = as_script(self.task, self.session.folder / "data")
        except EmsidError as problem:
            found["problem"] = str(problem)
        return found


def options_of(given: Mapping[str, Any]) -> dict[str, Any]:
    """Options of `emsid.identify` from texts; empty ones are left out.

    Raises:
        DataError: for an unknown option, or a text that is no number.
    """
    options: dict[str, Any] = {}
    for name, value in given.items():
        if value in ("", None, [], {}):
            continue
        try:
            if name in COUNTS:
                options[name] = int(value)
            elif name in NUMBERS:
                options[name] = float(value)
            elif name == "orders":
                parts = value.split(",") if isinstance(value, str) else value
                options[name] = [int(part) for part in parts]
            elif name in TEXTS:
                options[name] = str(value)
            elif name in LISTS:
                parts = value.split(",") if isinstance(value, str) else value
                options[name] = [str(part).strip() for part in parts]
            elif name == "fixed":
                options[name] = {str(key): str(each) for key, each in value.items()}
            else:
                raise DataError(f"there is no option {name}")
        except (ValueError, TypeError, AttributeError):
            raise DataError(f"{name}: {value!r} is not understood") from None
    return options


def catalogue() -> dict[str, Any]:
    """The models with their summaries, and which options each uses; static maps; examples; physical parameters."""
    from emsid.identification.candidates import CANDIDATES, USUAL, Physical
    from emsid.models.blocks.search.map_families import families
    from emsid.study.demonstration import EXAMPLES

    parameters: dict[str, str] = {}
    for candidate in CANDIDATES.values():
        if isinstance(candidate, Physical):
            for name, handle in candidate.plant.handles.items():
                parameters.setdefault(name, handle.parameter.unit)
    return {
        "models": [
            {"name": name, "summary": candidate.summary, "uses": list(candidate.uses), "usual": name in USUAL}
            for name, candidate in CANDIDATES.items()
        ],
        "static": list(families()),
        "parameters": [{"name": name, "unit": unit} for name, unit in parameters.items()],
        "examples": [{"name": example.name, "title": example.title} for example in EXAMPLES],
    }
