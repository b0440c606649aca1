"""``emsid list``."""

from emsid.cli.app import app
from emsid.cli.terminal import say


@app.command(name="list")
def list_() -> None:
    """List models, signals and file formats."""
    from emsid.excitation import SIGNALS
    from emsid.identification.candidates import CANDIDATES
    from emsid.io import READERS, WRITERS
    from emsid.models.blocks.search.map_families import families

    say("models for --models:")
    for name, candidate in CANDIDATES.items():
        say(f"  {name:<32}{candidate.summary}")
    say(f"static maps for --static: {', '.join(families())}")
    say("signals for --excitation:")
    for name, test_signal in SIGNALS.items():
        say(f"  {name:<32}{test_signal.__doc__}")
    say(f"files read: {', '.join(READERS)}")
    say(f"files written: {', '.join(WRITERS)}")
