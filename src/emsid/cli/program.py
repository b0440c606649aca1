"""The program, from installing the signal handlers to the exit status."""

import os
import signal
import sys
import warnings
from io import StringIO, TextIOWrapper
from typing import NoReturn

import typer
from typer.main import get_command

from emsid.cli import commands
from emsid.cli.app import FIRST_STEPS, app, for_words
from emsid.cli.interruption import INTERRUPTED, INTERRUPTION, TERMINATED, leave_quietly, open_streams, output_is_lost
from emsid.cli.options import with_options
from emsid.cli.terminal import SPELT_OUT, say, warn
from emsid.compiled import NOTICE
from emsid.errors import EmsidError
from emsid.replacing import sources_kept

USER_ERROR = 2

__all__ = ["commands", "main"]


def main() -> None:
    """Run the command line. An error of the user is printed as one line on standard error; its exit status is 2."""
    with sources_kept(), open_streams():
        _main()


def _main() -> None:
    INTERRUPTION.begin()
    NOTICE.say = warn
    if not sys.warnoptions:
        warnings.simplefilter("ignore")  # warnings are for programmers
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:  # a shell ignores it for background jobs
        signal.signal(signal.SIGINT, INTERRUPTION)
        if INTERRUPTION.own_process:
            INTERRUPTION.watch()
    signal.signal(signal.SIGTERM, INTERRUPTION.terminate)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors=SPELT_OUT)  # ^2 and ohm for a terminal without ² or Ω
    try:
        try:
            if len(sys.argv) > 1 or "_EMSID_COMPLETE" in os.environ:  # how a shell asks for completions
                words = None if "_EMSID_COMPLETE" in os.environ else sys.argv
                status = get_command(for_words(app, words))(sys.argv[1:], prog_name="emsid", standalone_mode=False)
            else:
                status = 0
                say(FIRST_STEPS)
        finally:
            sys.stdout.flush()
        if INTERRUPTION.pressed:
            _end_interrupted()
        if output_is_lost():
            _end("the output cannot be written: standard output is closed", USER_ERROR)
        sys.exit(status)
    except typer.TyperException as problem:  # an unknown option or argument, or one of another type
        message = getattr(problem, "format_message", problem.__str__)()
        command = getattr(getattr(problem, "ctx", None), "command_path", "emsid")
        _end(f"{message[:1].lower()}{message[1:].rstrip('.')}; see {command} --help", USER_ERROR)
    except EmsidError as problem:
        _end(with_options(problem), USER_ERROR)
    except OSError as problem:  # `emsid.io` handles files; this error is of standard output
        sys.stdout = StringIO()  # the rest of the output must not fail again at exit
        if isinstance(problem, BrokenPipeError):  # the reader of the pipe has closed it
            sys.exit(1)
        _end(f"the output cannot be written ({(problem.strerror or str(problem)).lower()})", USER_ERROR)
    except BaseException as problem:
        if INTERRUPTION.pressed and not (isinstance(problem, SystemExit) and problem.code == TERMINATED):
            _end_interrupted()
        raise
    finally:
        leave_quietly()


def _end_interrupted() -> NoReturn:
    """Print what happened to the interrupted work."""
    INTERRUPTION.pressed = False
    _end(INTERRUPTION.words, INTERRUPTED)


def _end(words: str, status: int) -> NoReturn:
    warn(words)
    sys.exit(status)
