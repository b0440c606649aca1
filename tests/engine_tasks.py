"""Tasks for the engine of fleets, in a module that other processes import quickly."""

import os
import signal
from collections.abc import Sequence
from pathlib import Path


def squares(tasks: Sequence[int]) -> list[int]:
    return [task * task for task in tasks]


def ending(folder: str, tasks: Sequence[int]) -> list[int]:
    """As `squares`; 7 ends the process every time, 20 the first time."""
    marked = Path(folder) / "ended"
    if 7 in tasks or (20 in tasks and not marked.exists()):
        if 20 in tasks:
            marked.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return squares(tasks)
