"""What the page can do: change the step, add files, fit, and the state that every page shows.

A step as a program in Python that gives the same numbers.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from threading import RLock
from typing import TYPE_CHECKING, Any

import numpy as np

import emsid
from emsid.errors import DataError, EmsidError
from emsid.estimation.borders import border
from emsid.exports import FORMATS
from emsid.options import IDENTIFY, READING, Declared
from emsid.studio.data import Data, arguments
from emsid.studio.session import CHOICE, EMPTY, KINDS, Conflict, Session, named
from emsid.studio.views import Views
from emsid.studio.words import field_name, label, said

if TYPE_CHECKING:
    from emsid.studio.live import Live
    from emsid.studio.runs import Runs


def _names(value: Any) -> list[str]:
    return [str(part).strip() for part in (value.split(",") if isinstance(value, str) else value)]


def _by_column(number: Callable[[str], Any]) -> Callable[[Any], dict[str, Any]]:
    def table(value: Any) -> dict[str, Any]:
        pairs = [part.rsplit("=", 1) for part in _names(value)] if isinstance(value, str) else value.items()
        return {str(name).strip(): number(each) for name, each in pairs}

    return table


def _rows(value: Any) -> list[int | None]:
    ends = value.split(":") if isinstance(value, str) else value
    first, last = (None if end in ("", None) else int(end) for end in ends)
    return [first, last]


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError
    return value


OF_KIND: dict[str, Callable[[Any], Any]] = {
    "whole": int,
    "number": float,
    "fraction": float,
    "sample time": float,
    "text": _text,
    "switch": bool,
    "names": _names,
    "columns": lambda value: _names(value) if isinstance(value, list) else _text(value),
    "wholes": lambda value: [int(part) for part in (value.split(",") if isinstance(value, str) else value)],
    "rows": _rows,
    "numbers by column": _by_column(float),
    "texts by column": _by_column(_text),
}
"""How what is typed into a field becomes the value of an option, by its kind."""
FIELDS = {each.name: each for each in IDENTIFY if each.kind in OF_KIND and each.name != "models"}
"""The options of a fit that have a field."""
READ = {each.name: each for each in READING if each.kind in OF_KIND}
"""The options of reading that have one."""


NO_RECORD = frozenset({"not-readable", "no-role-found"})
"""Findings that say why there is no record."""
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
        command: a task as a command line.
        announce: called when the state has changed.
    """

    session: Session
    runs: Runs
    live: Live
    command: Callable[[Mapping[str, Any], Path], str]
    announce: Callable[[dict[str, Any]], None] = lambda message: None
    data: Data = field(init=False)
    views: Views = field(init=False)
    _adding: Any = field(default_factory=RLock, init=False)

    def __post_init__(self) -> None:
        self.data = Data(self.session, lambda: self.announce({"kind": "state"}))
        self.views = Views(self.session, self.data)

    def warm(self) -> None:
        """Load what the first fit, free run, filter and unit need."""
        from emsid.estimation.linear.filtering import filtered

        with suppress(EmsidError):
            self.state()
            filtered([1.0], [1.0], [1.0])
            some = np.tile([0.0, 1.0], 50).astype(np.float64)
            emsid.Record(some, some, 1.0, output_units=("rpm",)).in_si().lowpass(0.1)

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
        before, step = step, {**step, **values}
        for name, given in values.get("given", {}).items():
            if given == before["given"].get(name, {}):
                continue
            try:
                self.data.record(step, name)
            except EmsidError as problem:  # where there was no record before, a first role is a beginning
                if given and self._readable(before, name):
                    findings = self.data.described(step, name)["findings"]
                    why = [each["text"] for each in findings if each["code"] in NO_RECORD]
                    raise DataError(why[0] if why else str(problem), arguments=problem.arguments) from None
        self.session.change(on, **values)
        self.announce({"kind": "state"})
        return {"version": on + 1}

    def _readable(self, step: Mapping[str, Any], name: str) -> bool:
        with suppress(EmsidError):
            self.data.record(step, name)
            return True
        return False

    def add(self, name: str, kind: str = "files") -> None:
        """Add a file of the session to the data; the first one is one to fit.

        Args:
            name: of the file.
            kind: one of `KINDS`.

        Raises:
            DataError: for another kind.
            EmsidError: where it cannot be read.
        """
        if kind not in KINDS:
            raise DataError(f"{kind} is none of {', '.join(KINDS)}")
        self.data.parsed(name)
        with self._adding:
            while True:  # unlike other changes, those that add a file do not exclude each other
                on, step = self.session.present
                key = kind if step["files"] else "files"
                files = [*step[key], name]
                if key == "files" and len(files) == 1:
                    self.data.reading({**step, key: files}, name)
                with suppress(Conflict):
                    self.change(on, step, **{key: files})
                    return

    def take(self) -> dict[str, list[str]]:
        """Add the records of the last source that was followed to the data; their names.

        Raises:
            DataError: where none was written.
        """
        folders = sorted(self.session.folder.glob("live-*"), key=lambda path: path.stat().st_mtime)
        records = sorted(folders[-1].glob("record*.csv")) if folders else []
        if not records:
            raise DataError("there is no record yet; stop the source first, which writes it")
        names = [self.session.add(path) for path in records]
        for name in names:
            self.add(name)
        return {"files": names}

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
        """Change parts of the step; ``given`` corrects the reading of a file: a None takes a correction back.

        Args:
            content: the parts; with ``given``, the ``file`` that it is of, by default the first one.
            version: that the change is made on.

        Raises:
            DataError: for a part that is none, or corrections without a file.
            EmsidError: where the data cannot be read like this.
        """
        (on, step), values = self._made_on(version), dict(content)
        file = values.pop("file", None)
        unknown = values.keys() - EMPTY.keys() | values.keys() & {"chosen_for"}
        if unknown:
            raise DataError(f"there is no {', '.join(sorted(unknown))} in a step")
        known = {*named(step)}
        for key in KINDS:
            if not set(values.get(key, [])) <= known:
                raise DataError("there is no such file")
        if not values.get("files", [""]) and values.get("unseen_files", step["unseen_files"]):
            raise DataError("unseen data need data to fit; choose some, or remove the unseen ones first")
        if "given" in values:
            values["given"] = self._said(step, step["files"][:1] if file is None else [str(file)], values["given"])
        if "options" in values:
            values["options"] = options_of(values["options"])
        if "unseen" in values and not 0 < float(values["unseen"]) < 1:
            raise DataError("the unseen part is a fraction between 0 and 1")
        if "models" in values:
            from emsid.identification.task import model_names

            values["models"] = list(model_names(values["models"])) if values["models"] else []
        if values.keys() & CHOICE.keys():
            now = {**step, **values}
            values["chosen_for"] = [*now["files"], *now["unseen_files"]]
        return self.change(on, step, **values)

    @staticmethod
    def _said(step: Mapping[str, Any], files: list[str], given: Mapping[str, Any]) -> dict[str, Any]:
        """The corrections of a step with further ones of some files.

        Raises:
            DataError: where there is no file, or a correction is not understood.
        """
        if not files or not {*files} <= {*named(step)}:
            raise DataError("there are no data to correct; drop a file or choose an example")
        said, read = dict(step["given"]), typed(READ, given)
        for name in files:
            merged = {**said.get(name, {}), **read}
            said[name] = {key: value for key, value in merged.items() if value is not None}
        return said

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
        if kind == "mask":
            before, new = self.data.reading(step, name).get("mask"), f"row >= {a} AND row < {b}"
            given: dict[str, Any] = {"mask": f"({before}) OR ({new})" if before else new}
        elif kind == "cut":
            given = {"rows": [a, b]}
        else:
            raise DataError("a brush can mask, cut or split")
        return self.change(on, step, given=self._said(step, [name], given))

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
        with self.session.adding(f"{name}.csv") as (file, incoming):
            write_record(found.record(), incoming)
            self.session.arrived(file)
            self.data.expect(file, found.reading)
            return self.change(on, step, files=[file], unseen_files=[], other_files=[])

    def _task_of(self, step: Mapping[str, Any]) -> dict[str, Any]:
        """What a run of a step is asked; ``reading`` also suits other files, for it concerns no samples."""
        if not step["files"]:
            raise DataError("there are no data; drop a file or choose an example")
        files = [*step["files"], *step["unseen_files"]]
        names = ("files", "unseen_files", "unseen", "models", "options")
        return {name: step[name] for name in names} | {
            "readings": {name: self.data.reading(step, name) for name in files},
            "reading": self.data.reading(step, step["files"][0], own=False),
            "contents": {name: self.session.digest(name) for name in files},
            "emsid": emsid.__version__,
        }

    def run(self, version: Any = None) -> dict[str, str]:
        """Fit; the number of the run."""
        number = self.runs.begin(self._task_of(self._made_on(version)[1]))
        self.announce({"kind": "run", "run": {**self.runs.state(number), "stale": []}})
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
            "live": self.live.state,
            "records": [],
        }
        problems: list[EmsidError] = []
        with border("data", report=problems.append):
            found["records"] = [self.data.summary(step, name) for name in named(step)]
        task: dict[str, Any] = {}
        if step["files"]:
            with border("task", report=problems.append):
                task = self._task_of(step)
                place = self.session.folder / "data"
                found["script"] = as_script(task, place)
                reading, *others = task["readings"].values()
                if all(other == reading for other in others):  # a command reads all files in one way
                    found["command"] = self.command({**task, "reading": reading}, place)
        states = self.runs.states
        found["models"] = self.views.models(states)
        found["runs"] = [{**run, "stale": differences(run["task"], task)} for run in states]
        found["problem"] = "; ".join(dict.fromkeys(said(each, self.session.folder) for each in problems))
        return found


def differences(task: Mapping[str, Any], present: Mapping[str, Any]) -> list[str]:
    """In what the data of a run, and the program that fitted it, differ from those of the present step.

    Args:
        task: of the run.
        present: the task of the present step; empty where that has none.
    """
    if not present or "readings" not in task:
        return ["data"]
    words = {"files": "files", "unseen_files": "unseen data"}
    found = [word for name, word in words.items() if task[name] != present[name]]
    if not present["unseen_files"] and task["unseen"] != present["unseen"]:
        found.append("part kept unseen")
    for name in task["readings"].keys() & present["readings"].keys():
        before, now = task["readings"][name], present["readings"][name]
        found += [key for key in {**before, **now} if before.get(key) != now.get(key)]
        found += [f"content of {name}"] if task["contents"][name] != present["contents"][name] else []
    found += ["version of emsid"] if task["emsid"] != present["emsid"] else []
    return list(dict.fromkeys(found))


def typed(fields: Mapping[str, Declared], given: Mapping[str, Any]) -> dict[str, Any]:
    """Values of options from what was typed; None where a field is empty.

    Raises:
        DataError: for an unknown option, or what is no value of its kind; its argument is the field.
    """
    found: dict[str, Any] = {}
    for name, value in given.items():
        if name not in fields:
            raise DataError(f"there is no option {name}")
        try:
            empty = value is None or (isinstance(value, str) and not value.strip() and name != "mask")
            found[name] = None if empty else OF_KIND[fields[name].kind](value)
        except (ValueError, TypeError, AttributeError):
            about = fields[name]
            raise DataError(f"{field_name(name)}: {value!r} is not understood; {about.meaning.lower()}") from None
    return found


def options_of(given: Mapping[str, Any]) -> dict[str, Any]:
    """Options of `emsid.identify` from texts; empty ones are left out.

    Raises:
        DataError: as `typed` does.
    """
    fixed = given.get("fixed") or {}
    if not isinstance(fixed, Mapping):
        raise DataError(f"{field_name('fixed')} are a table")
    options = typed(FIELDS, {name: value for name, value in given.items() if name != "fixed" and value not in ([], {})})
    options = {name: value for name, value in options.items() if value is not None}
    return options | ({"fixed": {str(key): str(each) for key, each in fixed.items()}} if fixed else {})


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

    def fields(some: Mapping[str, Declared]) -> list[dict[str, Any]]:
        names = ("name", "kind", "meaning", "metavar", "group", "unit")
        shown = [{**{n: getattr(each, n) for n in names}, "label": label(each.name)} for each in some.values()]
        return [{**each, "meaning": re.sub(r" \(see `emsid [a-z]+`\)", "", each["meaning"])} for each in shown]

    return {
        "models": [
            {"name": name, "summary": candidate.summary, "uses": list(candidate.uses), "usual": name in USUAL}
            for name, candidate in CANDIDATES.items()
        ],
        "options": fields(FIELDS),
        "reading": fields(READ),
        "static": list(families()),
        "parameters": [{"name": name, "unit": unit} for name, unit in parameters.items()],
        "examples": [{"name": each.name, "title": each.title, "about": each.contents} for each in EXAMPLES],
        "units": UNITS,
        "formats": sorted(FORMATS),
    }


def _reads(name: str, files: Mapping[str, Mapping[str, Any]], folder: Path) -> list[str]:
    """The lines that read files, by their names, into a list."""
    lines = [f"{name} = ["]
    for file, reading in files.items():
        lines += ["    emsid.read(", f"        {str(folder / file)!r},"]
        lines += [*(f"        {key}={value!r}," for key, value in arguments(reading).items()), "    ),"]
    return [*lines, "]"]


def as_script(task: Mapping[str, Any], folder: Path) -> str:
    """The program for a task, with the files in a folder.

    Args:
        task: files, the reading of each, models and options.
        folder: of the files.
    """

    def read(name: str, files: list[str]) -> list[str]:
        return _reads(name, {file: task["readings"][file] for file in files}, folder)

    lines = ["import emsid", "", *read("records", task["files"])]
    unseen = repr(task["unseen"])
    if task["unseen_files"]:
        unseen = "unseen"
        lines += read(unseen, task["unseen_files"])
    options = {**({"models": task["models"]} if task["models"] else {}), **task["options"]}
    words = ["records", unseen, *(f"{name}={value!r}" for name, value in options.items())]
    lines += [f"result = emsid.identify({', '.join(words)})", "print(result)"]
    return "\n".join(lines) + "\n"


def as_comparison(models: list[Path], file: Path, reading: Mapping[str, Any]) -> str:
    """The program that compares models on a file.

    Args:
        models: their files.
        file: of the data.
        reading: of it.
    """
    lines = ["import emsid", "", *_reads("records", {file.name: reading}, file.parent)]
    lines += ["models = [", *(f"    emsid.load({str(path)!r})," for path in models), "]"]
    return "\n".join([*lines, "print(emsid.compare(models, record=records))"]) + "\n"
