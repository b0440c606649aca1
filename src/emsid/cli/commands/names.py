"""``emsid list``."""

from emsid.cli.app import app
from emsid.cli.options import Json
from emsid.cli.terminal import say, say_json
from emsid.cli.writing import as_json


@app.command(name="list")
def list_(json: Json = False) -> None:
    """List models, signals and file formats."""
    from emsid.excitation import SIGNALS
    from emsid.exports import FORMATS
    from emsid.identification.candidates import CANDIDATES
    from emsid.io import READERS, WRITERS
    from emsid.models.blocks.search.map_families import families

    if json:
        signals = {name: signal.__doc__ for name, signal in SIGNALS.items()}
        models = {name: candidate.summary for name, candidate in CANDIDATES.items()}
        formats = {name: each.summary for name, each in FORMATS.items()}
        document = {"models": models, "static": list(families()), "excitation": signals, "exports": formats}
        say_json(as_json({"schema": 1, **document, "read": list(READERS), "written": list(WRITERS)}))
        return
    width = 2 + max(map(len, (*CANDIDATES, *SIGNALS)))
    say("models for --models:")
    for name, candidate in CANDIDATES.items():
        say(f"  {name:<{width}}{candidate.summary}")
    say(f"static maps for --static: {', '.join(families())}")
    say("signals for --excitation:")
    for name, test_signal in SIGNALS.items():
        say(f"  {name:<{width}}{test_signal.__doc__}")
    say("formats for export --to:")
    for name, format_ in FORMATS.items():
        say(f"  {name:<{width}}{format_.summary}")
    say(f"files read: {', '.join(READERS)}")
    say(f"files written: {', '.join(WRITERS)}")
