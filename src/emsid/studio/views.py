"""Compare: any models on any data, and every view of them as plots of the report, drawn by the page.

Models are those of all runs (``3/arx``) and those that were added as files (``files/motor.json``). Each has a number,
which gives its colour and does not change while the studio is open.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

import emsid
from emsid.errors import DataError, EmsidError
from emsid.estimation.borders import border
from emsid.exports.assumptions import assumed, sentences
from emsid.io import origin
from emsid.models import bands
from emsid.models.verbs import as_model
from emsid.record import Record
from emsid.record.holding_back import hold_back
from emsid.report.document import Axis, Band, Figure, Histogram, Ink, Level, Line, Mark, Plot, Points, Spans, Stroke
from emsid.report.views.analysis import over_frequency, over_time, poles_and_zeros
from emsid.report.views.bands import curve_with_band, regression_friction, static_map
from emsid.report.views.conventions import MODELS
from emsid.report.views.residuals import residuals
from emsid.report.views.sections import model_section
from emsid.studio.data import Data, Signal, packed
from emsid.studio.session import Session, in_session, named
from emsid.studio.use import loaded, sample_time, sliders
from emsid.studio.words import said
from emsid.units import plain_unit
from emsid.validation.comparison import Assessment, as_fit, validate

MOST = 5
"""Models in one view: so many colours can be distinguished beside that of the measurement."""
POINTS = 401
"""Points of a curve of a plant."""
KEPT = 32
"""Free runs that are kept in memory."""


@lru_cache(maxsize=256)
def _shown(path: str, changed: int) -> dict[str, Any]:
    found: dict[str, Any] = msgspec.json.decode(Path(path).read_bytes())
    return found


@dataclass
class Views:
    """The models of a session and their views.

    Args:
        session: with its runs and the models that were added.
        data: of the session.
    """

    session: Session
    data: Data
    _numbers: dict[str, int] = field(default_factory=dict)
    _runs: OrderedDict[Any, Assessment] = field(default_factory=OrderedDict)

    def models(self, runs: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
        """All models: their names, numbers and what their runs say of them.

        Args:
            runs: the states of all runs.
        """
        found: list[dict[str, Any]] = []
        for run in sorted(runs, key=lambda run: int(run["number"])):
            path, shown = self.session.folder / "runs" / run["number"] / "shown.json", {}
            if path.exists():
                shown = _shown(str(path), path.stat().st_mtime_ns)
            found += [
                {
                    "id": f"{run['number']}/{name}",
                    "name": name,
                    "run": run["number"],
                    "verdict": shown.get("verdicts", {}).get(name),
                    "chosen": shown.get("chosen") == name,
                }
                for name in run["models"]
            ]
        files = sorted((self.session.folder / "models").glob("*.json"))
        found += [{"id": f"files/{file.name}", "name": file.stem, "run": "", "chosen": False} for file in files]
        for each in found:
            each["number"] = self._numbers.setdefault(each["id"], len(self._numbers))
        return found

    def path(self, name: str) -> Path:
        """The file of a model.

        Raises:
            DataError: where there is no such model.
        """
        run, _, model = name.partition("/")
        place = "models" if run == "files" else f"runs/{run}"
        path = in_session(self.session.folder, f"{place}/{model}" + ("" if run == "files" else ".json"))
        if path is None or (run != "files" and not run.isdigit()):
            raise DataError("there is no such model")
        return path

    def label(self, name: str) -> str:
        """The name of a model as a legend has it."""
        run, _, model = name.partition("/")
        return model.removesuffix(".json") if run == "files" else f"{model} (run {run})"

    def about(self, name: str) -> dict[str, Any]:
        """What the page shows of one model: equation, parameters with intervals, channels, and what exports assume."""
        path = self.path(name)
        found, source = loaded(path), origin(path)
        fit = as_fit(found)
        shown: dict[str, Any] = {
            "label": self.label(name),
            "kind": fit.model.name,
            "equation": "",
            "parameters": [parameter(row) for row in fit.parameters.values()],
            "sliders": sliders(found),
            "dt": sample_time(path),
            "inputs": source.inputs if source else (),
            "outputs": source.outputs if source else (),
            "assumed": [row.name for row in assumed(fit)],
            "assumptions": sentences(fit),
        }
        with border("equation", expected=True):
            shown["equation"] = fit.model.equation()
        return shown

    def record(self, step: Mapping[str, Any], asked: Mapping[str, Any]) -> Record:
        """The data that are asked for: a file, or its part that is fitted or kept unseen."""
        name, part = str(asked["file"]), asked.get("part", "all")
        if name not in named(step):
            raise DataError("there is no such file")
        record = self.data.record(step, name)
        return record if part == "all" else hold_back(record, step["unseen"])[part == "unseen"]

    def assessed(self, step: Mapping[str, Any], name: str, asked: Mapping[str, Any], start: int = 0) -> Assessment:
        """A model run over data; each is run once.

        Raises:
            EmsidError: where it cannot be run on them.
        """
        path, file = self.path(name), str(asked["file"])
        record = self.record(step, asked)
        part = asked.get("part", "all")
        key = (
            *(path, path.stat().st_mtime_ns, file, self.session.stamp(file), str(self.data.reading(step, file))),
            *(part, None if part == "all" else step["unseen"], start),
        )
        if key not in self._runs:
            found, source = loaded(path), origin(path)
            seen = source is not None and source.seen(record)
            self._runs[key] = validate(found, record, start, data="identification" if seen else "unseen")
            while len(self._runs) > KEPT:
                self._runs.popitem(last=False)
        return self._runs[key]

    def _each(self, names: Sequence[Any], work: Callable[[str], Any]) -> tuple[dict[str, Any], dict[str, str]]:
        """What some work gives for every model, and why it fails for others."""
        done: dict[str, Any] = {}
        problems: dict[str, str] = {}
        for name in list(map(str, names))[:MOST]:
            failed: list[EmsidError] = []
            with border(self.label(name), report=failed.append):
                done[name] = work(name)
            if failed:
                problems[name] = said(failed[0])
        return done, problems

    def _together(
        self, step: Mapping[str, Any], names: Sequence[Any], asked: Mapping[str, Any]
    ) -> tuple[dict[str, Assessment], dict[str, str]]:
        """Models on the same samples of the same data."""
        memory, problems = self._each(names, lambda name: int(as_model(loaded(self.path(name))).memory))
        start = max(memory.values(), default=0)
        found, more = self._each([*memory], lambda name: self.assessed(step, name, asked, start))
        return found, problems | more

    def ranking(self, step: Mapping[str, Any], content: Mapping[str, Any]) -> dict[str, Any]:
        """How well models run freely over data, the best first."""
        record = self.record(step, content["data"])
        found, problems = self._together(step, content["models"], content["data"])
        rows = [
            {
                "id": name,
                "fit": each.row.fit_percent,
                "rmse": each.row.simulation_rmse,
                "parameters": each.row.parameters,
                "samples": each.row.samples,
                "data": each.row.data_label,
            }
            for name, each in sorted(found.items(), key=lambda item: item[1].row.ranked_by)
        ]
        time = record.time
        return {
            "rows": rows,
            "problems": problems,
            "inputs": [*zip(record.input_names, record.input_units, strict=True)],
            "outputs": [*zip(record.output_names, record.output_units, strict=True)],
            "first": float(time[0]),
            "last": float(time[-1]),
            "size": float(np.ptp(record.input[:, 0]) / 2),
        }

    def window(self, step: Mapping[str, Any], content: Mapping[str, Any]) -> bytes:
        """An output as measured, the free runs of models, and what they leave of it, in a window."""
        record, k = self.record(step, content["data"]), int(content.get("output", 0))
        found, _ = self._together(step, content["models"], content["data"])
        measured, nothing = np.ascontiguousarray(record.output[:, k]), np.full(len(record), np.nan)
        runs = [found[name].simulation.output[:, k] if name in found else nothing for name in content["models"][:MOST]]
        left = [found[name].errors[:, k] if name in found else nothing for name in content["models"][:MOST]]
        signals = [Signal(record.time, each, record.dt) for each in (measured, *runs, *left)]
        return packed(signals, float(content["from"]), float(content["to"]), int(content["width"]))

    def view(self, step: Mapping[str, Any], content: Mapping[str, Any]) -> dict[str, Any]:
        """A view of several models as plots.

        Args:
            step: with the data.
            content: ``view``, a name in `VIEWS`; ``models``; ``data``, perhaps without a file; ``input`` and
                ``output``, from 0; ``size`` of a step and the input ``at`` which models are linearised.

        Raises:
            DataError: for another view.
        """
        if content["view"] not in VIEWS:
            raise DataError(f"there is no view {content['view']}; there are {', '.join(VIEWS)}")
        data, names = content.get("data") or {}, content["models"]
        record = self.record(step, data) if data.get("file") else None
        asked: dict[str, Any] = {"input": int(content.get("input") or 0), "output": int(content.get("output") or 0)}
        asked |= {"at": float(content.get("at") or 0), "size": float(content.get("size") or 1)}
        if content["view"] == "correlation":
            found, problems = self._together(step, names, data) if record is not None else ({}, {})
        else:
            found, problems = self._each(names, lambda name: _Subject.of(self.path(name), record))
        labels = {name: self.label(name) for name in found}
        figures, more = VIEWS[content["view"]](found, labels, record, asked)
        of_ink = {MODELS[k].ink.name: names.index(name) for k, name in enumerate(found)}
        return {"plots": drawn(figures), "inks": of_ink, "problems": problems | more}


@dataclass(frozen=True)
class _Subject:
    """A fit with the sample time of its model or data."""

    fit: Any
    dt: float | None

    @classmethod
    def of(cls, path: Path, record: Record | None) -> _Subject:
        dt = sample_time(path)
        return cls(as_fit(loaded(path)), dt if dt is not None or record is None else record.dt)


Found = tuple[list[Figure], dict[str, str]]


def _analysed(
    found: Mapping[str, Any], labels: Mapping[str, str], analyse: Callable[[_Subject], Any]
) -> tuple[list[tuple[str, Stroke, Any]], dict[str, str]]:
    """An analysis of every model, with its label and look; and why it fails for others."""
    done, problems = [], {}
    for k, (name, subject) in enumerate(found.items()):
        failed: list[EmsidError] = []
        with border(labels[name], report=failed.append):
            done.append((labels[name], MODELS[k], analyse(subject)))
        if failed:
            problems[name] = said(failed[0])
    return done, problems


def _over_time(verb: Callable[..., Any]) -> Callable[..., Found]:
    def view(found: Any, labels: Any, record: Record | None, asked: Mapping[str, Any]) -> Found:
        done, problems = _analysed(
            found,
            labels,
            lambda each: verb(each.fit, asked["size"], at=asked["at"], dt=each.dt, input=asked["input"]),
        )
        names, strokes, curves = zip(*done, strict=True) if done else ((), (), ())
        return [over_time(curves, names, strokes)] if done else [], problems

    return view


def _bode(found: Any, labels: Any, record: Record | None, asked: Mapping[str, Any]) -> Found:
    path = {"input": asked["input"], "output": asked["output"]}
    done, problems = _analysed(found, labels, lambda each: emsid.bode(each.fit, at=asked["at"], dt=each.dt, **path))
    if record is not None:
        with border("spectrum", expected=True):
            done.insert(0, ("the data", Stroke(Ink.BLUE), emsid.bode(record, **path)))
    names, strokes, curves = zip(*done, strict=True) if done else ((), (), ())
    return [over_frequency(curves, names, strokes)] if done else [], problems


def _poles(found: Any, labels: Any, record: Record | None, asked: Mapping[str, Any]) -> Found:
    done, problems = _analysed(found, labels, lambda each: emsid.validation.analysis.pole_map(each.fit, asked["at"]))
    figures = []
    for discrete in (True, False):  # planes of z and of s
        alike = [each for each in done if (each[2].dt is not None) is discrete]
        if alike:
            names, strokes, maps = zip(*alike, strict=True)
            figures.append(poles_and_zeros(maps, names, strokes))
    return figures, problems


def _correlation(found: Mapping[str, Assessment], labels: Any, record: Record | None, asked: Any) -> Found:
    if not found:
        return [], {}
    called = [replace(each, row=replace(each.row, model=labels[name])) for name, each in found.items()]
    figure = residuals(called)
    return [replace(figure, plots=tuple(plot for plot in figure.plots if plot.x.quantity != "Time"))], {}


def _curves(found: Any, labels: Any, record: Record | None, asked: Any) -> Found:
    """Friction, dead zones and static maps; those with the same axes in one plot."""
    if record is None:
        raise DataError("choose data, over whose range the curves are drawn")
    plots: dict[tuple[str, str], Plot] = {}
    done, problems = _analysed(found, labels, lambda each: _curves_of(each.fit, record))
    for label, stroke, own in done:
        for plot in own:
            marks = tuple(_of_model(mark, stroke.ink, label) for mark in plot.marks)
            key = (plot.x.title, plot.y.title)
            before = plots[key].marks if key in plots else ()
            plots[key] = replace(plots.get(key, plot), marks=(*before, *marks), span=1)
    return [Figure("curves", "", tuple(plots.values()))] if plots else [], problems


def _curves_of(fit: Any, record: Record) -> list[Plot]:
    """The curves of a model: the laws of a plant, the maps of a cascade, or what a regression does at rest."""
    plant, blocks = getattr(fit.model, "plant", None), getattr(fit.model, "blocks", None)
    found = [
        plot for figure in model_section(fit, record).figures for plot in figure.plots if plot.x.quantity != "Time"
    ]
    if plant is None and blocks is None:
        for view in (static_map, regression_friction):
            with border("curve", expected=True):
                found += view(fit, record).plots
    moving = record.output if "/s" in record.output_units[0] else np.gradient(record.output, record.dt, axis=0)
    for kind, over in (("friction_characteristic", moving), ("dead_zone_characteristic", record.input)):
        declared = None if plant is None else getattr(plant, kind)()
        if declared is not None:
            reach = float(np.abs(over[:, 0]).max()) or 1.0
            x = np.linspace(-reach, reach, POINTS)
            curve = bands.with_error(fit, partial(_law, kind, x))
            marks = curve_with_band(bands.Band(x, *curve, 0.95), fit.model.name)
            found.append(Plot(marks, Axis(*declared.x), Axis(*declared.y)))
    return found


def _law(kind: str, x: Any, model: Any) -> Any:
    """A law of the plant of a model."""
    return getattr(model.plant, kind)().law(x)


def _of_model(mark: Mark, ink: Ink, label: str) -> Mark:
    """A curve of a model in its colour and with its name; other marks keep theirs."""
    own = getattr(mark, "ink", None) or getattr(getattr(mark, "stroke", None), "ink", None)
    if isinstance(mark, Line) and own is not Ink.GREY:
        return replace(mark, stroke=replace(mark.stroke, ink=ink), label=label if mark.label else "")
    return replace(mark, ink=ink, label="") if isinstance(mark, (Band, Points)) else mark


VIEWS: dict[str, Callable[..., Found]] = {
    "step": _over_time(emsid.step),
    "impulse": _over_time(emsid.impulse),
    "bode": _bode,
    "poles": _poles,
    "correlation": _correlation,
    "curves": _curves,
}
"""The views of models that are plots of the report; each takes what was found of the models, and gives figures."""


def drawn(figures: Sequence[Any]) -> list[dict[str, Any]]:
    """The plots of figures as data for the page."""
    return [
        {
            "title": plot.title,
            "caption": figure.caption,
            "x": {"title": plot.x.title, "log": plot.x.log, "range": plot.x.range},
            "y": {"title": plot.y.title, "log": plot.y.log, "range": plot.y.range},
            "marks": [_mark(mark) for mark in plot.marks if type(mark) in NAMES],
        }
        for figure in figures
        if isinstance(figure, Figure)
        for plot in figure.plots
    ]


NAMES: dict[type, str] = {
    Line: "line",
    Points: "points",
    Band: "band",
    Histogram: "histogram",
    Level: "level",
    Spans: "spans",
}
"""The marks that the page draws."""


def _mark(mark: Mark) -> dict[str, Any]:
    found: dict[str, Any] = {"kind": NAMES[type(mark)]}
    for name, value in vars(mark).items():
        if isinstance(value, np.ndarray):
            found[name] = value.tolist()
        elif isinstance(value, Stroke):
            found |= {"ink": value.ink.name, "dash": value.dash.value, "width": value.width}
        else:
            found[name] = value.name if isinstance(value, Ink) else value
    return found


def parameter(row: Any) -> dict[str, Any]:
    """A parameter with its 95 % interval, and what both depend on; plain where they depend on nothing."""
    low, high = row.interval or (None, None)
    return {
        "name": row.name,
        "unit": plain_unit(row.unit),
        "about": row.description,
        "value": row.value,
        "low": low,
        "high": high,
        "status": row.how,
        "plain": row.interval is not None and not row.given,
    }
