"""Start of the program. Ctrl-C works from the first moment on, also during the imports that follow.

Nothing that takes time is imported here.
"""

import os
import signal
import sys


def main() -> None:
    """Run the command line. Once imported, `emsid.cli` handles Ctrl-C."""
    _occupy_closed()
    sys.unraisablehook = _unraisable
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:  # a shell ignores it for background jobs
        signal.signal(signal.SIGINT, _leave)
    from emsid.cli import main
    from emsid.cli.interruption import INTERRUPTION

    INTERRUPTION.own_process = True
    try:
        main()
    except SystemExit as ending:
        _end(int(ending.code or 0))


def _occupy_closed() -> None:
    """Open the null device in place of standard streams that are closed: no file may get their numbers."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest free number


def _end(status: int) -> None:
    """End without waiting for threads that still compute, and without taking all modules apart, which takes 0.3 s."""
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:  # it is closed
            stream.flush()
    os._exit(status)


def _leave(*_: object) -> None:
    """End at once: nothing has started yet, and a half-imported library may lose an exception."""
    os.write(2, b"emsid: interrupted; there is no result\n")
    os._exit(130)


def _unraisable(problem: "sys.UnraisableHookArgs") -> None:
    """Report an exception that was lost in a callback, except Ctrl-C, which sets a flag."""
    if not isinstance(problem.exc_value, KeyboardInterrupt):
        sys.__unraisablehook__(problem)


if __name__ == "__main__":
    main()
