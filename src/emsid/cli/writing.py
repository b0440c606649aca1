"""Writing of results, model files and the report into a folder, and the messages about them."""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from emsid.cli.interruption import INTERRUPTION, print_notice
from emsid.cli.options import option
from emsid.cli.terminal import say, warn, working
from emsid.errors import DataError, EmsidError
from emsid.wording import sentence

if TYPE_CHECKING:
    from emsid.identification import Identification
    from emsid.record import Record
    from emsid.report.document import Report
    from emsid.study import Study

LEFT_OUT = "the report is left out"
"""What Ctrl-C during the drawing is answered."""

COMPLETING = "curves and the next experiment are left out; the results follow (Ctrl-C again: end without them)"
"""What Ctrl-C after the searches is answered."""

REPORT = "report.html"
"""The page of a result."""

Result = TypeVar("Result", "Study", "Identification")


MARKS = (b"emsid", b'{\n  "schema": ', b'{"motor": ', b'<html lang="en" class="no-script">')
"""What the first bytes of every report, document, model file and journal of this program contain."""


def check_folder(folder: Path, *results: str, given: str = "--out ") -> None:
    """Refuse a folder that cannot be written to, or holds files of others, before a long search starts.

    A command replaces the results of an earlier run, never another file.

    Args:
        folder: to write into.
        results: the names of files that will be written into it, the main one first: where that is of this program,
            all of them are.
        given: how the command line names it.
    """
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not (there.is_dir() and os.access(there, os.W_OK | os.X_OK)):
        raise DataError(f"{given}{folder}: {there} is not a folder that can be written to; choose another")
    found = [folder / name for name in results if (folder / name).exists()]
    if found and found[0].name == results[0] and _is_own(found[0]):
        return
    for path in found:
        if not _is_own(path):
            raise DataError(f"{given}{folder}: {path.name} in it is not a result of emsid; choose another folder")


def _is_own(path: Path) -> bool:
    """Whether a file is a result of this program, by its first bytes; an empty one has nothing to lose."""
    from emsid.io.files import first_bytes

    head = first_bytes(path)
    return head is not None and (not head or any(mark in head for mark in MARKS))


def check_file(path: Path, force: bool) -> None:
    """Refuse a file that exists, or whose folder cannot be written to, before anything is done.

    Args:
        path: to write.
        force: whether it may be replaced.
    """
    check_folder(path.parent)
    if path.exists() and not force:
        raise DataError(f"{path} exists; name another file, or replace it", arguments=("out", "force"))


def write(
    folder: Path,
    documents: Mapping[str, Any],
    fits: Any = (),
    origin: "Callable[[Any], Record] | None" = None,
    reading: Mapping[str, Any] | None = None,
) -> None:
    """Write JSON documents and model files into a folder.

    Args:
        folder: the folder.
        documents: content by name of the file.
        fits: fits that are saved with their tables.
        origin: the record that a fit was identified from.
        reading: arguments with which that record was read.
    """
    from emsid.io import atomic_write, save
    from emsid.io.files import together, write_several

    def save_document(name: str) -> None:
        atomic_write(folder / name, as_json(documents[name]))

    def save_one(fit: Any) -> None:
        save(fit, folder / f"{fit.model.name}.json", origin(fit) if origin else None, reading)

    with together():
        problem = attempted(
            lambda: write_several(save_one, fits),
            *(partial(save_document, name) for name in documents),  # after the model files, which it names
        )
    if problem is not None:
        raise problem


def attempted(*works: Callable[[], object]) -> EmsidError | None:
    """Do all that writes files or prints, and return the first error of it, to raise it after everything else.

    A full disk must not take a result away that was computed for minutes.
    """
    from emsid.estimation.borders import border

    problems: list[EmsidError] = []
    for work in works:
        with border("output", report=problems.append, passing=OSError):
            work()
    return problems[0] if problems else None


def as_json(content: Any) -> bytes:
    """A document as indented JSON; what it is made by is loaded at the first call."""
    from emsid.io.files import indented_json

    return indented_json(content)


def completed(result: "Identification") -> "tuple[Identification, dict[str, Any]]":
    """The result with all that follows from the models, and its content; Ctrl-C leaves out what takes long.

    What is computed once remains with the result that is returned.
    """

    def leave(words: str) -> None:
        print_notice(words)
        raise KeyboardInterrupt

    if not INTERRUPTION.pressed:
        try:
            with INTERRUPTION.asked(COMPLETING, leave):
                return result, result.to_data()
        except KeyboardInterrupt:
            INTERRUPTION.pressed = True
    stopped = replace(result, interrupted=True)
    with INTERRUPTION.put_off():
        return stopped, stopped.to_data()


@contextmanager
def kept(result: "Result", what: str) -> Iterator["Result"]:
    """Let a result be written and printed even if Ctrl-C is pressed meanwhile.

    Afterwards Ctrl-C stops the next step, the drawing. The first one, if it is pressed meanwhile, does not: the drawing
    takes a second, and another Ctrl-C leaves it out.
    """
    stopped = result.interrupted or INTERRUPTION.pressed
    INTERRUPTION.pressed = False
    with INTERRUPTION.put_off():
        yield replace(result, interrupted=stopped) if stopped and not result.interrupted else result
    if INTERRUPTION.pressed and not stopped:
        INTERRUPTION.pressed, INTERRUPTION.late = False, True
    INTERRUPTION.words = f"{what} was interrupted; the results so far are printed above and written"


def draw(
    folder: Path,
    report: Callable[[], "Report"],
    pdf: bool = False,
    *,
    interrupted: bool = False,
) -> tuple[str, ...]:
    """Draw the report with its figures, with PDF on request, and write it; no files if Ctrl-C was pressed meanwhile.

    Args:
        folder: where to.
        report: what to draw.
        pdf: whether figures are written as PDF too.
        interrupted: whether Ctrl-C has stopped the search; then a message says that the drawing follows.
    """
    try:
        INTERRUPTION.raise_again()
        from emsid.estimation.borders import border, collected
        from emsid.report.document import Report
        from emsid.report.page import report_files, write_files

        with working(LEFT_OUT) as control, collected() as noted:
            content = Report("Report", ("The report could not be made; the results are in the other files.",), ())
            with border("report"):
                content = report()
            if interrupted or INTERRUPTION.late:
                print_notice(f"drawing the report with {len(list(content.figures))} figures (Ctrl-C: leave it out)")
            files = report_files(content, control, ("svg", "pdf") if pdf else ("svg",))
    except BaseException as problem:
        if not (INTERRUPTION.pressed or isinstance(problem, KeyboardInterrupt)) or isinstance(problem, SystemExit):
            raise
        return ()
    with INTERRUPTION.put_off():
        write_files(files, folder)
    if INTERRUPTION.pressed and not (interrupted or INTERRUPTION.late):
        INTERRUPTION.words = "interrupted after everything was written"
    for each in noted:
        warn(sentence(each, option))
    return tuple(files)


def say_where(folder: Path, drawn: Sequence[str], *names: str, possible: Iterable[str] = ()) -> None:
    """Print where the files are, and which files there are from an earlier run.

    Args:
        folder: of the results.
        drawn: the files of the report.
        names: the other files.
        possible: files that an earlier run may have left.
    """
    report = (REPORT, "figures/") if drawn else ()
    say(f"written to {folder}/: {', '.join((*report[:1], *names, *report[1:]))}")
    old = [name for name in (REPORT, *possible) if name not in (*drawn, *names) and (folder / name).exists()]
    figures = sum(path.relative_to(folder).as_posix() not in drawn for path in folder.glob("figures/*"))
    if old or figures:
        old += [f"{figures} in figures/"] if figures else []
        say(f"from an earlier run, not from this one: {', '.join(old)}")
