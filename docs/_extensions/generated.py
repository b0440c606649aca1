"""Pages that are made from the program, before Sphinx looks for its pages: the command line, the findings, the library.

They are written to ``reference/`` and are not part of the repository.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from importlib import import_module
from inspect import cleandoc
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

HOME = Path(__file__).resolve().parents[2]
READING = "identify", "describe", "validate"
"""Commands whose common options are those for reading files."""


def command_line() -> str:
    """The page of all commands with their arguments and options."""
    import typer

    from emsid.cli import commands  # noqa: F401 - registers them
    from emsid.cli.app import FIRST_STEPS, app

    group = typer.main.get_command(app)
    reading = set.intersection(*(set(option_names(group.commands[name])) for name in READING)) - {
        "json",
        "help",
        "out",
        "files",
    }
    lines = ["# Command line", "", "What `emsid` alone prints:", "", "```text", FIRST_STEPS, "```", ""]
    lines += ["`emsid --help`, and `--help-all` or `--help` after every command, print what stands here.", ""]
    lines += ["Errors are one line on standard error. The exit status is 0, 2 for an error of the user, and 130 after"]
    lines += ["Ctrl-C, which keeps the results so far.", ""]
    for name, command in commands_of(group):
        lines += [f"## emsid {name}", "", *described(command.help or "")]
        lines += table(command, reading)
        if reading <= set(option_names(command)):
            lines += ["And the [options for reading files](#options-for-reading-files).", ""]
    lines += ["## Options for reading files", "", "For `describe`, `identify`, `validate` and `study`.", ""]
    lines += table(group.commands["identify"], set(option_names(group.commands["identify"])) - reading)
    return "\n".join(lines) + "\n"


def commands_of(group: Any, before: str = "") -> Iterator[tuple[str, Any]]:
    """Every command below a group, with its words."""
    for name, command in sorted(group.commands.items()):
        if hasattr(command, "commands"):
            yield from commands_of(command, f"{before}{name} ")
        else:
            yield f"{before}{name}", command


def option_names(command: Any) -> list[str]:
    """The names of the parameters of a command."""
    return [each.name for each in command.params]


def described(text: str) -> list[str]:
    """The help of a command as Markdown; examples, which follow a backspace character, as a block."""
    parts = cleandoc(text).split("\b\n")
    lines = [*parts[0].strip().splitlines(), ""]
    for part in parts[1:]:
        heading, *examples = part.strip("\n").splitlines()
        lines += [heading, "", "```text", *(each.removeprefix("  ") for each in examples), "```", ""]
    return lines


def table(command: Any, without: set[str]) -> list[str]:
    """The arguments and options of a command as a table, but for some."""
    rows = []
    for each in command.params:
        if each.name in without or each.name == "help":
            continue
        argument = each.param_type_name == "argument"
        spelled = each.metavar if argument else ", ".join(sorted(each.opts, key=len))
        value = "" if argument or each.is_flag else f" {each.metavar or ''}"
        default = each.default
        shown = isinstance(default, int | float | str | Path) and not isinstance(default, bool) and default != ""
        words = re.sub(r"([|*<>\[\]])", r"\\\1", each.help or "") + (f" Default: `{default}`." if shown else "")
        option = (spelled + value).strip().replace("|", "\\|")
        rows.append(f"| `{option}` | {words} |")
    return ["| option | meaning |", "|---|---|", *rows, ""] if rows else []


SUBJECTS = {
    "data": "The data",
    "files": "Files and columns",
    "agreement": "Several records, and model files",
    "identification": "Identification",
    "verdict": "Verdicts and recommendation",
    "linear": "Regressions",
    "blocks": "Cascades of blocks",
    "plants": "Physical models",
    "live": "Live tracking",
    "study": "The study",
}
"""Headings of the modules in `emsid.wording`."""


def findings() -> str:
    """The page of all codes: severity, what triggers each, what to do, and an example of its sentence."""
    from emsid.wording import CATALOGUE

    known = tomllib.loads((HOME / "docs/reference/triggers.toml").read_text("utf-8"))
    spoken = sentences()
    lines = [*cleandoc(FINDINGS).splitlines(), ""]
    modules = dict.fromkeys(entry.wording.__module__.rpartition(".")[2] for entry in CATALOGUE.values())
    for module in sorted(modules, key=lambda name: [*SUBJECTS, name].index(name)):
        lines += [f"## {SUBJECTS.get(module, module)}", ""]
        for code, entry in CATALOGUE.items():
            if entry.wording.__module__.rpartition(".")[2] != module:
                continue
            when, action = known.get(code, ("", ""))
            lines += [f"(finding-{code})=", f"### {code}", ""]
            lines += [f"*{entry.severity.value}* – when: {when}. What to do: {action}.", ""] if when else []
            lines += [f"> {escaped(said)}\n" for said in spoken[code]]
            if entry.wording.__doc__:
                lines += [escaped(" ".join(cleandoc(entry.wording.__doc__).split())), ""]
    return "\n".join(lines) + "\n"


def escaped(text: str) -> str:
    """A text without markup, for Markdown."""
    return re.sub(r"([|*<>\[\]_`$~])", r"\\\1", text)


FINDINGS = """
    # Findings

    What *emsid* notices is a finding: a code, what it is about, and data. The terminal and the report show it as a
    sentence; `result.json` has the code and the data, for programs. A code keeps its meaning within a version of the
    format. Sentences below are examples, as the command line words them; in Python they name arguments without hyphens.

    *info* is information, a *warning* limits what the result can be used for, and with a *problem* the result should
    not be used until it is corrected.
    """


def sentences() -> dict[str, list[str]]:
    """Examples of the sentences by code, at most two, as the command line words them."""
    found: dict[str, list[str]] = {}
    pinned = (HOME / "tests/wording/sentences.txt").read_text("utf-8")
    for block in re.split(r"^(?=\S)", pinned, flags=re.MULTILINE)[1:]:
        heading, *said = block.splitlines()
        found.setdefault(heading.split()[0], []).append(said[-1].strip())
    return {code: list(dict.fromkeys(said))[:2] for code, said in found.items()}


TOPICS = {
    "fit": ("Fitting and identification", "`emsid.fit` fits one model, `emsid.identify` fits and ranks several."),
    "records": ("Records and files", "A record is a sampled experiment. Readers make one, and estimators take one."),
    "compare": ("Comparison", "Free run and prediction of models on records that they were not fitted to."),
    "linear": ("Linear models", "ARMAX, Box–Jenkins and state space; ARX and output error are regressions."),
    "regression": ("Regressions", "Structures that are linear in their parameters, and the models they become."),
    "blocks": ("Cascades of blocks", "Filters and static maps in a row, fitted to the free run."),
    "plants": ("Plants", "Physical equations whose parameters are estimated."),
    "simulation": ("Motor, bench and test signals", "The motor of the paper, a virtual bench, and test signals."),
    "estimation": ("Estimators", "Arrays and records in, estimates out; for methods of your own."),
    "errors": ("Errors and findings", "Errors that a user can do something about, and facts that were noticed."),
    "other": ("Further parts", "What belongs to no other page."),
}
"""Pages of the reference to the library: title and a sentence."""
PLACES = {
    "record": "records", "io": "records", "first_look": "records",
    "models.verbs": "fit", "identification": "fit", "estimation.fit": "fit",
    "validation": "compare", "models.model": "compare", "models.free_run": "compare",
    "models.regression": "regression", "regression": "regression",
    "models.linear": "linear", "linear": "linear", "models.feedback": "blocks", "models.blocks": "blocks",
    "blocks": "blocks", "models.plants": "plants", "plants": "plants",
    "plant": "simulation", "excitation": "simulation",
    "estimation": "estimation", "errors": "errors", "findings": "errors",
}  # fmt: skip
"""The page of what is defined in a module."""


def library() -> dict[str, str]:
    """The pages of the library by name: every public name stands once, where its module belongs."""
    import emsid

    stub = (HOME / "src/emsid/__init__.pyi").read_text("utf-8")
    groups: dict[str, list[tuple[str, list[str]]]] = {name: [] for name in TOPICS}
    seen: set[int] = set()
    for module, name in re.findall(r"^from \.(\S+) import (\w+)", stub, re.MULTILINE):
        page = groups[place(module)]
        if not page:
            page.append(("emsid", []))
        page[0][1].append(name)
        seen.add(id(getattr(emsid, name)))
    for name in re.findall(r"^from \. import (\w+)", stub, re.MULTILINE):
        part = getattr(emsid, name)
        new = [each for each in part.__all__ if id(getattr(part, each)) not in seen]
        seen |= {id(getattr(part, each)) for each in new}
        if new:
            groups[place(name)].append((f"emsid.{name}", new))
    pages = {name: library_page(*TOPICS[name], parts) for name, parts in groups.items() if parts}
    contents = ["# Python, by topic", "", "Names that stand here are public; others may change.", ""]
    pages["index"] = "\n".join([*contents, "```{toctree}", ":maxdepth: 1", *pages, "```", ""])
    return pages


def place(module: str) -> str:
    """The page for what is defined in a module."""
    parts = module.split(".")
    known = (".".join(parts[:size]) for size in range(len(parts), 0, -1))
    return next((PLACES[each] for each in known if each in PLACES), "other")


def library_page(title: str, intro: str, parts: list[tuple[str, list[str]]]) -> str:
    """A page of the reference to the library."""
    lines = [f"# {title}", "", intro, ""]
    for module, names in parts:
        lines += [f"## In {module}", ""] if len(parts) > 1 else []
        lines += ["```{eval-rst}", f".. currentmodule:: {module}", ""]
        part = import_module(module)
        for name in sorted(names, key=lambda name: (isinstance(getattr(part, name), type), name.lower())):
            value = getattr(part, name)
            kind = "autoclass" if isinstance(value, type) else "autofunction" if callable(value) else "autodata"
            if kind == "autodata":
                entries = ", ".join(f"``{each}``" for each in value)
                lines += [f".. data:: {name}", "", f"   A registry by name: {entries}.", ""]
            else:
                lines += [f".. {kind}:: {name}", ""]
        lines += ["```", ""]
    return "\n".join(lines)


def write(app: Sphinx) -> None:
    """Write the pages that have changed."""
    reference = Path(app.srcdir) / "reference"
    pages = {"command-line": command_line(), "findings": findings()}
    pages |= {f"api/{name}": text for name, text in library().items()}
    for path in (reference / "api").glob("*.md"):
        if f"api/{path.stem}" not in pages:
            path.unlink()
    for name, text in pages.items():
        path = reference / f"{name}.md"
        path.parent.mkdir(exist_ok=True)
        if not path.exists() or path.read_text("utf-8") != text:
            path.write_text(text, "utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("builder-inited", write)
    return {"parallel_read_safe": True}
