"""``emsid describe``."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from emsid.cli.app import app
from emsid.cli.interruption import INTERRUPTION
from emsid.cli.options import Json, option
from emsid.cli.reading import command_line, identify_words, reads_records
from emsid.cli.terminal import say, say_json, show, text_table, width_of_terminal
from emsid.cli.writing import REPORT, as_json, check_folder, draw, say_where

if TYPE_CHECKING:
    from emsid.findings import Finding
    from emsid.first_look import FirstLook, Group
    from emsid.first_look.together import Hypothesis
    from emsid.record import Record

COLUMNS = 30
"""At most this many columns of a file are printed; the page and the JSON document have all."""
SYSTEMS = 11
"""At most this many commands for further systems in a file, as for the joints of a robot; each takes another look."""
IN_FULL = 3
"""Of more files than this, each is described in a line."""


@app.command()
@reads_records()
def describe(
    reader: Any,
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE", help="Files to look at; none where --output is FILE:COL.", show_default=False),
    ] = [],  # noqa: B006
    tolerance: Annotated[
        float,
        typer.Option(
            metavar="FRACTION",
            help="Singular values of the lagged input below this fraction of the largest are no excitation.",
        ),
    ] = 1e-3,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Write a page with plots into this folder.")] = None,
    json: Json = False,
) -> None:
    """Look at files: columns, input, output, time, quality.

    No option is needed: the likely input, output, time and units are found. The last lines are commands for
    `emsid identify`, one for each system.

    \b
    Examples:
      emsid describe log.csv
      emsid describe log.csv --output speed --dt 10ms --out page
      emsid describe --input x.csv:1 --output y.csv:1
    """
    from emsid.first_look import describe_files, groups, without_findings_of_all
    from emsid.first_look.together import of_pairs
    from emsid.report.views.conventions import in_words
    from emsid.report.views.first_look import of_all_files
    from emsid.wording import sentence

    if out is not None:
        check_folder(out, REPORT)
    paths = files or reader.files([])
    looks, together = describe_files(paths, tolerance=tolerance, **reader.given)
    divided = groups(looks)
    systems = list(dict.fromkeys(pair for group in divided[:1] for look in group.looks for pair in look.roles.others))
    others = of_pairs(paths, reader.given, systems[:SYSTEMS] if len(divided) == 1 else [])
    commands = [command_line(words) for words in proposals([*divided, *others])]
    if json:
        documents = [as_document(look) for look in looks]
        found = [finding.to_data() for finding in together]
        joint = [
            {"files": [look.path for look in group.looks], "findings": [each.to_data() for each in group.findings]}
            for group in divided
        ]
        parts = {"records": documents, "findings": found, "together": joint, "commands": commands}
        say_json(as_json({"schema": 1, **parts}))
    else:
        alone = [without_findings_of_all(look, divided) for look in looks]
        for look in alone:
            if len(looks) > IN_FULL:
                say(f"{look.name}: {in_words(look.record) if look.record is not None else 'no record'}")
            else:
                _print(look)
        if len(looks) > IN_FULL:
            say(*_counted(alone))
        say(*(f"- {sentence(finding, option)}" for finding in together))
        for title, said in of_all_files(divided, option):
            say(f"{title}:", *(f"- {each}" for each in said))
    if out is not None:
        from emsid.report.views.first_look import report

        INTERRUPTION.words = "drawing the page was interrupted; everything else is printed"
        drawn = draw(out, lambda: report(looks, together, divided, commands, option))
        if not json:
            say_where(out, drawn)
    if not json:
        say("", "next:" if commands else "nothing to identify here: see above", *(f"  {each}" for each in commands))


def _print(look: "FirstLook") -> None:
    """Everything about a file."""
    from emsid.report.views.first_look import column_table, curves, lines

    show(text_table(column_table(look, COLUMNS)))
    if (sys.stdout.encoding or "").lower().startswith("utf"):
        say(*curves(look, min(width_of_terminal(), 110)))
    say(*lines(look, option))


def _counted(looks: "Sequence[FirstLook]") -> list[str]:
    """The findings of many files: the first of each code about each column, with its file, and how many have such."""
    from emsid.wording import sentence

    alike: dict[tuple[str, str], list[tuple[str, Finding]]] = {}
    for look in looks:
        for finding in look.findings:
            of_column = "" if finding.subject == look.name else finding.subject
            others = alike.setdefault((finding.code, of_column), [])
            if look.name not in dict(others):
                others.append((look.name, finding))
    return [
        f"- in {len(found)} of {len(looks)} files, {'such as ' if len(found) > 1 else ''}{name}: "
        f"{sentence(finding, option).removeprefix(f'{name}: ')}"
        for found in alike.values()
        for name, finding in found[:1]
    ]


def proposals(divided: "Sequence[Group | Hypothesis]") -> list[list[str]]:
    """The words of the commands to run next, one for each group of files, or for each system in them."""
    return [identify_words(group) for group in divided]


def as_document(look: "FirstLook") -> dict[str, Any]:
    """A look as JSON: the columns, the guesses, the record and the findings."""
    from emsid.findings import plain

    document: dict[str, Any] = {
        "file": look.path,
        "rows": look.rows,
        "looked_at": look.looked_at or look.rows,
        "kind": str(look.kind),
        "columns": [
            {
                "name": column.name,
                "kind": column.kind,
                "quantity": column.meaning.quantity.value,
                "unit": column.meaning.unit,
                "low": column.low,
                "high": column.high,
                "step": column.step,
                "missing": column.missing,
                "codes": [{"value": code.value, "count": code.count, "output": code.response} for code in column.codes],
            }
            for column in look.columns
        ],
        "guesses": {
            "input": {"column": look.roles.input, "confidence": look.roles.input_confidence},
            "output": {"column": look.roles.output, "confidence": look.roles.output_confidence},
            "time": {"column": look.clock.column, "dt": look.clock.dt, "confidence": look.clock.confidence}
            | {"evidence": look.clock.evidence},
            "kind": {"file": look.kind.kind, "evidence": look.kind.evidence},
            "pairs": [{"input": u, "output": y, "left": left} for u, y, left in look.roles.tried],
        },
        "response": {"delay": look.response.delay, "sign": look.response.sign},
        "findings": [finding.to_data() for finding in look.findings],
    }
    if look.record is not None:
        document |= _record_as_document(look.record, look.tolerance)
    result: dict[str, Any] = plain(document)
    return result


def _record_as_document(record: "Record", tolerance: float) -> dict[str, Any]:
    """The channels of a record, and how well its input excites."""
    from emsid.excitation import crest_factor, largest_order, persistent_excitation_order

    order, largest = persistent_excitation_order(record, tolerance=tolerance), largest_order(record)
    names, units = record.input_names + record.output_names, record.input_units + record.output_units
    described = [(name, unit, record.channel(name)) for name, unit in zip(names, units, strict=True)]
    return {
        "record": record.name,
        "samples": len(record),
        "segments": len(record.breaks) + 1,
        "dt": record.dt,
        "channels": [
            {
                "name": name,
                "unit": unit,
                "min": float(x.min()),
                "max": float(x.max()),
                "mean": float(x.mean()),
                "deviation": float(x.std()),
            }
            for name, unit, x in described
        ],
        "crest_factor": float(crest_factor(record)) if record.input.any() else None,
        "persistent_excitation_order": int(order),
        "at_least": bool(order == largest),
    }
