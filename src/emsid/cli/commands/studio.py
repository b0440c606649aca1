"""``emsid studio``."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from emsid.cli.app import app
from emsid.cli.options import option
from emsid.cli.reading import as_options, command_line, file_word
from emsid.cli.terminal import say
from emsid.cli.writing import check_folder
from emsid.errors import DataError, FormatError

INSTALL = "pip install 'emsid[studio]'"
PLOTS = "python -m emsid.studio.uplot"


@app.command()
def studio(
    files: Annotated[list[Path], typer.Argument(metavar="FILE", help="Files to begin with.", show_default=False)] = [],  # noqa: B006
    session: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder of the session; one that exists is continued.")
    ] = Path("emsid-studio"),
    port: Annotated[int, typer.Option(metavar="N", help="Port on this machine; 0: a free one.", min=0, max=65535)] = 0,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in a browser.")] = True,
) -> None:
    """Look at data, fit and compare models in the browser.

    The page is served on this machine only, under an address with a secret token, and loads nothing from a network.
    Everything that is done is kept in the folder of the session. Ctrl-C ends the server.

    \b
    Examples:
      emsid studio
      emsid studio log.csv
      emsid studio --session emsid-studio --no-browser
    """
    try:
        from emsid.studio import server
    except ModuleNotFoundError as problem:
        if problem.name not in ("starlette", "uvicorn"):
            raise
        raise FormatError(f"the studio needs {problem.name}, which is not installed; run {INSTALL}") from None
    if not server.uplot.is_there():
        raise FormatError(f"the studio needs uPlot, which is not installed; run {PLOTS} (or `make studio` in a clone)")
    check_folder(session, given="--session ")
    missing = [path for path in files if not path.exists()]
    if missing:
        raise DataError(f"{missing[0]}: there is no such file")
    server.serve(
        session,
        files,
        port=port,
        browser=browser,
        command=command_of,
        track=track_of,
        say=lambda address: say(f"studio: {address}", f"session: {session}/ (Ctrl-C ends the server)"),
    )


def command_of(task: Mapping[str, Any], folder: Path) -> str:
    """A task of the studio as the command line that gives the same numbers.

    >>> task = {"files": ["a.csv"], "unseen_files": [], "unseen": 0.3, "reading": {"input": "u", "rows": [0, 9]}}
    >>> command_of(task | {"models": ["arx"], "options": {"nk": 1, "fixed": {"R": "2 ohm"}}}, Path("data"))
    "emsid identify data/a.csv --input u --rows 0:9 --unseen 0.3 --models arx --nk 1 --fix 'R=2 ohm'"
    """
    rows = task["reading"].get("rows")
    reading = {**task["reading"], **({} if rows is None else {"rows": slice(*rows)})}
    words = ["emsid", "identify", *(file_word(str(folder / name)) for name in task["files"]), *as_options(reading)]
    for name in task["unseen_files"]:
        words += ["--validate", file_word(str(folder / name))]
    if not task["unseen_files"]:
        words += ["--unseen", f"{task['unseen']:.10g}"]
    if task["models"]:
        words += [option("models"), ",".join(task["models"])]
    for name, value in task["options"].items():
        if name == "fixed":
            for parameter, known in value.items():
                words += ["--fix", f"{parameter}={known}"]
        else:
            words += [option(name), ",".join(map(str, value)) if isinstance(value, list) else f"{value}"]
    return command_line(words)


def track_of(asked: Mapping[str, Any], folder: Path) -> list[str]:
    """The program that follows a live source and prints JSON lines."""
    names = ("structure", "na", "nb", "nk", "header", "input", "output", "time", "dt", "baud", "forgetting")
    given = {name: str(asked.get(name) or "").strip() for name in names}
    words = [f"{option(name)}={text}" for name, text in given.items() if text]
    program = [sys.executable, "-m", "emsid", "track", "--json", "--every=0.05"]  # a plot that moves
    return [*program, "--out", str(folder), *words, "--", str(asked["source"])]
