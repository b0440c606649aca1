"""What the page can do: change the step, add files, fit, and the state that every page shows.

A step as a program in Python that gives the same numbers.

What can be done about a finding, as a change of the step that a button of the page makes.

Export of a model for other programs, as an archive of the files that `emsid.export` writes.
"""

from __future__ import annotations

import io
import tempfile
import zipfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from threading import RLock
from typing import TYPE_CHECKING, Any

from starlette.responses import Response

import emsid
from emsid.errors import DataError, EmsidError
from emsid.estimation.borders import border
from emsid.exports import FORMATS
from emsid.io import origin
from emsid.models.verbs import as_model
from emsid.options import IDENTIFY
from emsid.studio.data import Data, arguments
from emsid.studio.play import loaded
from emsid.studio.session import CHOICE, EMPTY, Conflict, Session

if TYPE_CHECKING:
    from pathlib import Path

    from emsid.studio.live import Live
    from emsid.studio.runs import Runs


OF_KIND: dict[str, Callable[[Any], Any]] = {
    "whole": int,
    "number": float,
    "text": str,
    "names": lambda value: [str(part).strip() for part in (value.split(",") if isinstance(value, str) else value)],
    "wholes": lambda value: [int(part) for part in (value.split(",") if isinstance(value, str) else value)],
}
"""How a text that is typed into a field becomes the value of an option, by its kind."""
FIELDS = {each.name: each for each in IDENTIFY if each.kind in OF_KIND and each.name != "models"}
"""The options that have a field."""
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
        step, before = {**step, **values}, step["given"]
        for name, given in values.get("given", {}).items():
            if given == before.get(name, {}):
                continue
            if name != step["files"][0]:
                self.data.record(step, name)
            elif self.data.look(step).record is None and given:
                found = self.data.described(step)
                said = [each["text"] for each in found["findings"] if each["code"] in NO_RECORD]
                raise DataError(said[0] if said else "no record can be read like this")
        self.session.change(on, **values)
        self.announce({"kind": "state"})
        return {"version": on + 1}

    def add(self, name: str, *, unseen: bool = False) -> None:
        """Add a file of the session to the data.

        Raises:
            EmsidError: where it cannot be read.
        """
        self.data.parsed(name)
        with self._adding:
            while True:  # unlike other changes, those that add a file do not exclude each other
                on, step = self.session.present
                key = "unseen_files" if unseen and step["files"] else "files"
                files = [*step[key], name]
                if len(files) == 1:
                    self.data.look({**step, key: files})
                with suppress(Conflict):
                    self.change(on, step, **{key: files})
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
        """Change parts of the step; ``given`` corrects the reading of the first file: a None takes a correction back.

        Raises:
            DataError: for a part that is none, or corrections without a file.
            EmsidError: where the data cannot be read like this.
        """
        (on, step), values = self._made_on(version), dict(content)
        unknown = values.keys() - EMPTY.keys() | values.keys() & {"chosen_for"}
        if unknown:
            raise DataError(f"there is no {', '.join(sorted(unknown))} in a step")
        known = {*step["files"], *step["unseen_files"]}
        for key in ("files", "unseen_files"):
            if not set(values.get(key, [])) <= known:
                raise DataError("there is no such file")
        if "given" in values:
            values["given"] = self._said(step, step["files"][:1], values["given"])
        if "options" in values:
            values["options"] = options_of(values["options"])
        if "unseen" in values and not 0 < float(values["unseen"]) < 1:
            raise DataError("the unseen part is a fraction between 0 and 1")
        if "models" in values:
            from emsid.identification.task import model_names

            values["models"] = list(model_names(values["models"])) if values["models"] else []
        if not values.get("files", [""]):
            values["unseen_files"] = []
        if values.keys() & CHOICE.keys():
            now = {**step, **values}
            values["chosen_for"] = [*now["files"], *now["unseen_files"]]
        return self.change(on, step, **values)

    @staticmethod
    def _said(step: Mapping[str, Any], files: list[str], given: Mapping[str, Any]) -> dict[str, Any]:
        """The corrections of a step with further ones of some files.

        Raises:
            DataError: where there is no file.
        """
        if not files:
            raise DataError("there are no data to correct; drop a file or choose an example")
        said = dict(step["given"])
        for name in files:
            merged = {**said.get(name, {}), **given}
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
            return self.change(on, step, files=[file], unseen_files=[])

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
            "catalogue": catalogue(),
            "units": UNITS,
            "live": self.live.state,
        }
        problems: list[EmsidError] = []
        with border("data", report=problems.append):
            found["data"] = self.data.described(step)
        task: dict[str, Any] = {}
        if step["files"]:
            with border("task", report=problems.append):
                task = self._task_of(step)
                place = self.session.folder / "data"
                found["script"] = as_script(task, place)
                reading, *others = task["readings"].values()
                if all(other == reading for other in others):  # a command reads all files in one way
                    found["command"] = self.command({**task, "reading": reading}, place)
        found["runs"] = [{**run, "stale": differences(run["task"], task)} for run in self.runs.states]
        found["problem"] = "; ".join(dict.fromkeys(map(str, problems)))
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
            if name in FIELDS:
                options[name] = OF_KIND[FIELDS[name].kind](value)
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
        "options": [{"name": each.name, "meaning": each.meaning, "unit": each.unit} for each in FIELDS.values()],
        "static": list(families()),
        "parameters": [{"name": name, "unit": unit} for name, unit in parameters.items()],
        "examples": [{"name": example.name, "title": example.title} for example in EXAMPLES],
    }


def as_script(task: Mapping[str, Any], folder: Path) -> str:
    """The program for a task, with the files in a folder.

    Args:
        task: files, the reading of each, models and options.
        folder: of the files.
    """

    def read(name: str, files: list[str]) -> list[str]:
        lines = [f"{name} = ["]
        for file in files:
            given = arguments(task["readings"][file])
            lines += ["    emsid.read(", f"        {str(folder / file)!r},"]
            lines += [*(f"        {key}={value!r}," for key, value in given.items()), "    ),"]
        return [*lines, "]"]

    lines = ["import emsid", "", *read("records", task["files"])]
    unseen = repr(task["unseen"])
    if task["unseen_files"]:
        unseen = "unseen"
        lines += read(unseen, task["unseen_files"])
    options = {**({"models": task["models"]} if task["models"] else {}), **task["options"]}
    words = ["records", unseen, *(f"{name}={value!r}" for name, value in options.items())]
    lines += [f"result = emsid.identify({', '.join(words)})", "print(result)"]
    return "\n".join(lines) + "\n"


def formats() -> list[str]:
    """The formats of `emsid.export`."""
    return sorted(FORMATS)


def exported(path: Path, format: str, assume: Sequence[str] = ()) -> Response:
    """A model in a format, as an archive.

    Args:
        path: the model file.
        format: its name.
        assume: parameters whose values nobody gave or measured and that may be written.

    Raises:
        DataError: for an unknown format.
        EmsidError: where the model cannot be exported like this.
    """
    if format not in FORMATS:
        raise DataError(f"there is no format {format}; there are {', '.join(FORMATS)}")
    found, source, content = loaded(path), origin(path), io.BytesIO()
    dt = source.dt if source is not None and as_model(found).dt is None else None
    with tempfile.TemporaryDirectory() as folder:
        emsid.export(found, format, folder, dt=dt, force=True, assume=tuple(assume))
        with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
            for file in sorted(Path(folder).rglob("*")):
                if file.is_file():
                    archive.write(file, file.relative_to(folder))
    headers = {"content-disposition": f'attachment; filename="{path.stem}-{format}.zip"'}
    return Response(content.getvalue(), media_type="application/zip", headers=headers)
