"""The program's way in: it can be interrupted from its first moment on, also amid the imports that follow.

So nothing is imported here that takes time.
"""

import os
import signal
import sys


def main() -> None:
    """Run the command line; `emsid.cli` takes over from here when it has been imported."""
    sys.unraisablehook = _unraisable
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:  # as a shell does for what runs in the background
        signal.signal(signal.SIGINT, _leave)
    from emsid.cli import main

    main()


def _leave(*_: object) -> None:
    """End at once: nothing has been begun yet, and an exception may be lost in a half-imported library."""
    os.write(2, b"emsid: interrupted before anything was found\n")
    os._exit(130)


def _unraisable(problem: "sys.UnraisableHookArgs") -> None:
    """Say what was lost in a callback, unless it is Ctrl-C, which is remembered."""
    if not isinstance(problem.exc_value, KeyboardInterrupt):
        sys.__unraisablehook__(problem)


if __name__ == "__main__":
    main()
