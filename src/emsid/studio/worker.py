"""The process of one identification: it reads, identifies and writes into the folder of a run.

    python -m emsid.studio.worker SESSION RUN

Progress is written to standard output as lines of JSON. A line on standard input cancels: the search ends with what it
has. So does the end of standard input, which is where the server has ended. Every fit is saved as soon as it is found.
"""

from __future__ import annotations

import sys
import time
from contextlib import suppress
from logging import StreamHandler
from pathlib import Path
from threading import Event, Thread
from typing import Any

import msgspec

import emsid
from emsid.errors import EmsidError
from emsid.estimation import Control
from emsid.estimation.borders import LOG, border, collected
from emsid.estimation.nonlinear.control import Activity, Stopped
from emsid.findings import Finding, plain
from emsid.identification import Identification
from emsid.io import atomic_write, save
from emsid.io.files import NotWritten, indented_json, together
from emsid.report.document import Report
from emsid.report.identification_page import report
from emsid.report.page import report_files, write_files
from emsid.studio.data import arguments, edit_for
from emsid.studio.words import field_name, in_page
from emsid.studio.words import said as in_terms_of_page
from emsid.wording import as_python, sentence, severity

OFTEN = 0.1
"""Seconds between two reports of progress."""


def main() -> None:
    """Run the identification of the folder that is named on the command line."""
    session, run = Path(sys.argv[1]), Path(sys.argv[2])
    task, cancelled = msgspec.json.decode((run / "task.json").read_bytes()), Event()
    Thread(target=wait_for_end, args=(cancelled,), daemon=True).start()
    LOG.setLevel("DEBUG")
    LOG.addHandler(StreamHandler())  # tracebacks are in the log of the run

    def failed(problem: Exception) -> None:
        message = in_terms_of_page(problem, session) if isinstance(problem, EmsidError) else str(problem)
        say(kind="failed", message=message)
        with suppress(NotWritten):
            atomic_write(run / "problem.json", msgspec.json.encode({"message": message}))

    try:
        with border("run", report=failed):
            result = identified(session, run, task, Control(cancelled=cancelled.is_set, report=Progress()))
            write_result(result, run, task)
    except Stopped as problem:
        failed(problem)


def wait_for_end(cancelled: Event) -> None:
    """Cancel once standard input has a line or has ended."""
    sys.stdin.readline()
    cancelled.set()


def say(**message: Any) -> None:
    """Write a line for the server."""
    with suppress(OSError):  # the server has ended; what was found is written all the same
        sys.stdout.write(msgspec.json.encode(plain(message)).decode() + "\n")
        sys.stdout.flush()


class Progress:
    """Reports an activity at most every `OFTEN` seconds, and each that begins."""

    def __init__(self) -> None:
        self._begun, self._last, self._doing = time.monotonic(), 0.0, ""

    def __call__(self, activity: Activity) -> None:
        """Report an activity."""
        now = time.monotonic()
        if activity.doing != self._doing or now - self._last > OFTEN:
            self._last, self._doing = now, activity.doing
            seconds = now - self._begun
            progress = {"doing": activity.doing, "done": activity.done, "total": activity.total, "cost": activity.cost}
            say(kind="progress", seconds=seconds, **progress)


def identified(session: Path, run: Path, task: dict[str, Any], control: Control) -> Identification:
    """The identification of a task; every fit is saved as it is found."""
    control.doing("reading")
    records, others = (
        [emsid.read(session / "data" / name, **arguments(task["readings"][name])) for name in task[kind]]
        for kind in ("files", "unseen_files")
    )

    def finished(fit: Any) -> None:
        save(fit, run / f"{fit.model.name}.json", reading=task["reading"])
        error: dict[str, Any] = {"fit": None}
        with border("fit", fit.model.name, expected=True):
            error["fit"] = emsid.compare(fit, record=records).best.row.fit_percent
        say(kind="fit", model=fit.model.name, ending=fit.ending.value, **error)

    return emsid.identify(
        records,
        others or task["unseen"],
        models=task["models"] or None,
        control=control,
        finished=finished,
        **task["options"],
    )


def write_result(result: Identification, run: Path, task: dict[str, Any]) -> None:
    """Write models, result, the report, and what the page shows, in this order."""
    reading = task["reading"]
    say(kind="progress", doing="writing", done=0, total=None)
    with together():
        for fit in result.fits:
            save(fit, run / f"{fit.model.name}.json", result.data_of(fit), reading)
        if result.is_usable:
            save(result.recommended_fit, run / "best.json", result.fitted_by_recommended, reading)
        atomic_write(run / "result.json", indented_json(result.to_data()))
    with collected() as noted:
        content = report(result, as_python)
        with border("report"):
            write_files(report_files(content), run)
        shown = as_shown(result, content)
    shown["findings"] += [said(finding, result) for finding in noted]
    atomic_write(run / "shown.json", msgspec.json.encode(plain(shown)))


def as_shown(result: Identification, content: Report) -> dict[str, Any]:
    """What the page shows of a result: its summary, the ranking, findings and verdicts."""
    findings = [*result.recommendation, *result.next_steps, *result.findings]
    models = [fit.model.name for fit in result.fits]
    rows = {row.model: row for row in result.rows}
    return {
        "summary": [in_page(each) for each in content.summary],
        "models": models,
        "chosen": result.chosen.model.name,
        "usable": result.is_usable,
        "ranking": [
            {"model": row.model, "fit": row.fit_percent, "rmse": row.simulation_rmse, "parameters": row.parameters}
            for row in (rows[name] for name in models)
        ],
        "verdicts": {
            verdict.model: {"level": verdict.code.removeprefix("model-"), "text": sentence(verdict, field_name)}
            for verdict in result.model_verdicts
        },
        "unit": result.unseen.output_units[0],
        "findings": [said(finding, result) for finding in findings],
    }


def said(finding: Finding, result: Identification) -> dict[str, Any]:
    """A finding with what the page can do about it."""
    return {
        "text": sentence(finding, field_name),
        "severity": severity(finding).value,
        "model": finding.model,
        "edit": edit_for(finding, result.record),
    }


if __name__ == "__main__":
    main()
