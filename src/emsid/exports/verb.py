"""`emsid.export`: a model in another format, with a README that says what it is and what could not be carried."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from emsid.arguments import as_names_with_commas
from emsid.errors import ModelError, listed
from emsid.estimation.estimates import Status
from emsid.estimation.fit import Fit
from emsid.exports.assumptions import assumed, refuse_assumed, sentences
from emsid.exports.formats import Export, Files
from emsid.exports.quality import quality
from emsid.exports.registry import format_of
from emsid.io.files import write_new
from emsid.models.kinds import capabilities_of
from emsid.models.verbs import as_model
from emsid.record import Record

README = "README.md"
RESERVED = frozenset(
    """auto break case char const continue default do double else enum extern float for goto if inline int long register
    restrict return short signed sizeof static struct switch typedef union unsigned void volatile while""".split()  # noqa: SIM905
)
"""Words of C that are no names."""
PROBE = 2_000
"""Samples of a free run with a constant input, which shows whether a model runs away."""


@np.errstate(all="ignore")  # a model whose numbers overflow is refused below
def export(
    model: Any,
    to: str,
    out: str | os.PathLike[str],
    *,
    name: str | None = None,
    dt: float | None = None,
    force: bool = False,
    unseen: Record | Mapping[str, float] | None = None,
    assume: str | Sequence[str] = (),
    **options: Any,
) -> list[Path]:
    """Write a model in another format, and a README beside it.

    Args:
        model: a model, or a fit; of a fit the README has the intervals of the parameters.
        to: the format by its name, see `emsid.exports.FORMATS`.
        out: the folder to write to.
        name: of files and functions; by default that of the model.
        dt: sample time in s, for a model that has none of its own; of a fit, C and MATLAB take that of its data.
        force: whether files that exist are replaced.
        unseen: a record that the model was not fitted to, for the fit of its free run in the README, or that fit as
            ``fit_percent``, ``simulation_rmse`` and ``samples``.
        assume: parameters whose values nobody gave or measured and that may be written into a format of physical
            values, by name or symbol: ``("resistance",)``, or a text with commas; the files then say so.
        options: of the format; ``single=True`` for C in single precision.

    Returns:
        The files that were written.

    Raises:
        ModelError: for a model that the format cannot carry, one that runs away, a name that C cannot hold, an assumed
            value that may not be written, or an unknown format or option.
        DataError: for an unseen record that the model cannot run on.
        FormatError: where files exist or cannot be written.
    """
    kind = format_of(to)
    unknown = [option for option in options if option not in kind.options]
    if unknown:
        have = listed(list(kind.options)) if kind.options else "none"
        raise ModelError(f"{to} has no option {unknown[0]!r}; it has {have}", arguments=(unknown[0],))
    subject = as_model(model)
    step = _dt(subject, dt)
    check_stable(subject, step)
    fit, record = model if isinstance(model, Fit) else None, unseen if isinstance(unseen, Record) else None
    if kind.physical:
        refuse_assumed(fit, to, as_names_with_commas(assume))
    made = Export(subject, fit, c_name(name or subject.name), step, options, record)
    files, notes = kind.function(made)
    if kind.physical:
        files = {file: commented(file, content, sentences(fit)) for file, content in files.items()}
    files = {**files, README: readme(made, to, notes, files, quality(subject, unseen))}
    return write_new(files, out, force=force)


COMMENTS = {".xml": "<!-- {} -->", ".mo": "// {}", ".h": "// {}", ".py": "# {}", ".yaml": "# {}", ".cfg": "# {}"}
"""How a line of a comment is written, by the ending of the file."""


def commented(file: str, content: str | bytes, lines: Sequence[str]) -> str | bytes:
    """The content of a file with lines of comment before it; a format without comments has them in its README."""
    comment = COMMENTS.get(Path(file).suffix)
    if comment is None or isinstance(content, bytes):
        return content
    return "".join(f"{comment.format(line)}\n" for line in lines) + content


def _dt(model: Any, dt: float | None) -> float | None:
    """The sample time of a model, or that given.

    Raises:
        ModelError: for one that is not positive, or another one than that of the model.
    """
    if dt is not None and not (isfinite(dt) and dt > 0):
        raise ModelError(f"a sample time of {dt!r} s; give a positive number", arguments=("dt",))
    if dt is not None and model.dt is not None and not np.isclose(dt, model.dt, rtol=1e-6, atol=0.0):
        raise ModelError(f"{model.name} has a sample time of {model.dt:g} s; leave dt out", arguments=("dt",))
    own: float | None = model.dt
    return dt if own is None else own


def c_name(name: str) -> str:
    """A name for files and functions: hyphens and other signs become underscores.

    >>> c_name("rigid-motor")
    'rigid_motor'

    Raises:
        ModelError: for a name that C cannot hold even then.
    """
    found = re.sub(r"[^A-Za-z0-9_]", "_", name)
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,30}", found) or found in RESERVED:
        raise ModelError(
            f"{name!r} cannot be a name in C; give one that begins with a letter, has at most 31 letters, digits and "
            "underscores, and is no word of C",
            arguments=("name",),
        )
    return found


def check_stable(model: Any, dt: float | None) -> None:
    """Refuse a model whose free run grows without bound at rest.

    Raises:
        ModelError: for such a model.
    """
    from emsid.models.starting import start

    stepper = start(model, dt=dt or 1e-3)
    ends = [model.run(stepper.state, np.full((PROBE * k, stepper.inputs), 1e-6))[0][-1] for k in (1, 2)]
    if not np.isfinite(ends).all() or np.max(np.abs(ends[1])) > 1e6 * max(np.max(np.abs(ends[0])), 1e-6):
        raise ModelError(f"{model.name} is unstable: its free run grows without bound; identify another model")


def _sources(made: Export, format: str) -> list[str]:
    """What is assumed among the values, and whether the files depend on it."""
    said = sentences(made.fit)
    if all(row.status is Status.KEPT for row in assumed(made.fit)) and said and not format_of(format).physical:
        said.append("The files carry the behaviour from input to output, which does not depend on what is assumed.")
    if not said and capabilities_of(made.model).physical and (made.fit is None or not made.fit.table):
        said = ["The sources of the values are not known: the model has no table of a fit."]
    return [*(f"- {line}" for line in said), *([""] if said else [])]


def readme(made: Export, format: str, notes: list[str], files: Files, fit: str) -> str:
    """What the files are, how good the model is, and what could not be carried."""
    from emsid.units import plain_unit

    lines = [f"# {made.name}", "", f"The model {made.model.name} as {format}, made by emsid.", ""]
    if made.dt is not None:
        lines += [f"Sample time: {made.dt!r} s.", ""]
    if made.fit is not None and made.fit.channels is not None:
        for what, channels in (("Input", made.fit.channels.inputs), ("Output", made.fit.channels.outputs)):
            lines += [
                f"{what} {k}: {name}, in {plain_unit(unit) or 'the unit of the record'}."
                for k, (name, unit) in enumerate(channels)
            ]
        lines.append("")
    lines += [
        "Files: " + ", ".join(files) + ".",
        "",
        "## Equation",
        "",
        "```",
        made.model.equation(),
        "```",
        "",
        fit,
        "",
    ]
    if made.fit is not None and made.fit.parameters:
        lines += ["## Parameters", "", "| parameter | value | 95 % interval | unit | status |", "|---|---|---|---|---|"]
        for row in made.fit.parameters.values():
            interval = "–" if row.interval is None else "{:.4g} … {:.4g}".format(*row.interval)
            lines.append(f"| {row.name} | {row.value:.6g} | {interval} | {plain_unit(row.unit) or '–'} | {row.how} |")
        lines.append("")
    lines += _sources(made, format)
    lines += ["## What is not carried", ""]
    lines += [f"- {note}" for note in notes]
    lines.append("- The noise and the intervals of the parameters: the files give the free run of the estimates.")
    return "\n".join(lines) + "\n"
