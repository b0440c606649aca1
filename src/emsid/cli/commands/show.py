"""``emsid show``."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from emsid.cli.app import app
from emsid.cli.interruption import INTERRUPTION
from emsid.cli.options import Json, PageFolder, option
from emsid.cli.terminal import say, say_json, show, text_table
from emsid.cli.writing import REPORT, as_json, check_folder, draw, say_where, write

if TYPE_CHECKING:
    from emsid.estimation.fit import Fit
    from emsid.report.document import Report, Section

ModelFiles = Annotated[list[Path], typer.Argument(metavar="MODEL", help="Model files that emsid wrote.")]
Step = Annotated[float, typer.Option(metavar="X", help="Size of the step, in the unit of the input.")]


@app.command(name="show")
def show_models(models: ModelFiles, step: Step = 1.0, out: PageFolder = None, json: Json = False) -> None:
    """Show saved models: parameters, responses, poles.

    Prints the equation, every parameter with its interval or the reason why there is none, poles and gain. With --out,
    a page has the step response, the frequency response and the poles, those of several models in the same axes.

    \b
    Examples:
      emsid show emsid-result/rigid-motor.json
      emsid show emsid-result/arx.json emsid-result/output-error.json --step 6 --out shown
      emsid show emsid-result/arx.json --json
    """
    from emsid.estimation.borders import border, collected
    from emsid.io import load
    from emsid.validation.comparison import as_fit
    from emsid.wording import sentence

    fits = [as_fit(load(path)) for path in models]
    if out is not None:
        check_folder(out, "models.json", REPORT)
    linear = [_linear(fit) for fit in fits]
    both = zip(fits, linear, strict=True)
    result = {"schema": 1, "models": [fit.to_data() | {"linear": part} for fit, part in both]}
    with collected() as noted:
        for fit, part in [] if json else zip(fits, linear, strict=True):
            with border(f"table of {fit.model_name}"):
                _print(fit, part)
    if json:
        say_json(as_json(result))
    say(*([] if json else (f"- {sentence(finding, option)}" for finding in noted)))
    if out is not None:
        with INTERRUPTION.put_off():
            write(out, {"models.json": result})
        INTERRUPTION.words = "interrupted; the figures are left out"
        drawn = draw(out, lambda: _report(models, fits, step))
        if not json:
            say_where(out, drawn, "models.json")
        INTERRUPTION.end(not drawn)


def _channels(fit: "Fit[Any]") -> str:
    """Where a model was identified, as far as its file says."""
    from emsid.units import in_unit
    from emsid.wording.lists import sample_time

    if fit.channels is None:
        return ""
    inputs, outputs = (
        ", ".join(in_unit(*each) for each in side) for side in (fit.channels.inputs, fit.channels.outputs)
    )
    return f"from {inputs} to {outputs}, identified at a sample time of {sample_time(fit.channels.dt)}"


def _linear(fit: "Fit[Any]") -> dict[str, Any] | None:
    """Poles, zeros and gain of the linear part, about an input of zero; None for a model without one."""
    from emsid.errors import EmsidError
    from emsid.findings import finite
    from emsid.validation.analysis import linearize, modes, pole_map

    try:
        part, found, oscillating = linearize(fit), pole_map(fit), modes(fit)
    except EmsidError:
        return None
    pairs = ([[float(each.real), float(each.imag)] for each in several] for several in (found.poles, found.zeros))
    gain = [[finite(each) for each in row] for row in part.gain.tolist()]
    columns = {
        name: [finite(x) if name != "kind" else x for x in each.tolist()]
        for name, each in oscillating.columns().items()
    }
    rest = {"gain": gain, "dt": part.dt, "modes": columns}
    return dict(zip(("poles", "zeros"), pairs, strict=True)) | rest


def _print(fit: "Fit[Any]", linear: dict[str, Any] | None) -> None:
    """Everything about a model, as tables and sentences."""
    from emsid.report.notebook import tables
    from emsid.validation.analysis import modes

    before, table, after = tables(fit)
    say(*before, *filter(None, [_channels(fit)]), *([] if fit.table else [str(fit.model)]))
    if table is not None:
        show(text_table(table))
    if linear is not None:
        numbers = [complex(*pole) for pole in linear["poles"]]
        shown = ", ".join(f"{each:.4g}" if each.imag else f"{each.real:.4g}" for each in numbers)
        say(f"poles {'in 1/s' if linear['dt'] is None else 'in z'}, for small changes: {shown or 'none'}")
        gains = [f"{each:.4g}" if each is not None else "infinite" for row in linear["gain"] for each in row]
        say(f"gain, for small changes: {', '.join(gains)}")
        if linear["modes"]["kind"]:
            say(*str(modes(fit)).splitlines())
    say(*(f"- {each}" for each in after))


def _report(paths: list[Path], fits: "list[Fit[Any]]", step: float) -> "Report":
    """A page with the responses of all models in the same axes, and the parameters of each."""
    from emsid.estimation.borders import joined
    from emsid.report.document import Report, Section
    from emsid.report.notebook import tables
    from emsid.report.views.analysis import model_figures

    def section(fit: "Fit[Any]") -> "Section":
        before, table, after = tables(fit)
        rows = () if table is None else (table,)
        return Section(
            fit.model_name,
            paragraphs=tuple(filter(None, (*before, _channels(fit)))),
            equations=() if fit.table else (str(fit.model),),
            tables=rows,
            remarks=tuple(after),
        )

    names = ", ".join(dict.fromkeys(fit.model_name for fit in fits))
    responses = Section("", figures=model_figures(fits, [(0.0, step)]))
    works = {
        f"section of the page: {path}": partial(lambda f: [section(f)], fit)
        for path, fit in zip(paths, fits, strict=True)
    }
    return Report(
        title=names,
        summary=(f"Step of {step:g}, frequency response and poles of {names}, from their files.",),
        opening=responses,
        sections=tuple(joined(works)),
        imprint=f"emsid show {' '.join(path.name for path in paths)}",
    )
