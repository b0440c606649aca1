"""What mechanisms of the searches are worth: the distribution of the baseline with each of them switched off.

    python bench/ablation.py --only motors --models rigid-motor --seeds 61-63 --out ablation/
    python bench/ablation.py "second starts" restarts --only "motor|fan" --seeds 0

Every mechanism is a function of the program that is replaced by one that does nothing. The first row of the table is
the undisturbed program; the others have the same systems and seeds. Beside the distribution (see ``bench/baseline.py``)
stand the number of systems whose error changes by more than `CHANGED`, and the smallest and largest error over that of
the undisturbed program. A mechanism whose absence changes nothing in the distribution can be deleted.

``--out`` names a folder with a file of JSON lines for every row; a file that has some already is continued.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from rich.table import Table

from arguments import numbers, parser_of
from baseline import SUPPORTED, SYSTEMS, WITHIN, Line, console, measured, read, simulated

UNDISTURBED = "undisturbed"
CHANGED = 0.01
"""The relative change of an error that counts."""
PLANTS, SEARCH = "emsid.models.plants.search", "emsid.models.search.driver"
Replaced = tuple[str, str, Callable[..., Any]]
"""A module, the path of a function in it, and what takes its place."""


def nothing(*_: Any, **__: Any) -> None:
    """In place of a function that gives nothing where it finds nothing."""


def no_values(*_: Any, **__: Any) -> tuple[()]:
    """In place of a function that gives values to try."""
    return ()


def refused(*_: Any, **__: Any) -> bool:
    """In place of a function that says whether something has changed."""
    return False


def as_reached(_task: Any, reached: Any, *_: Any) -> Any:
    """In place of a stage after a search."""
    return reached


MECHANISMS: Mapping[str, tuple[Replaced, ...]] = {
    "second starts": ((f"{PLANTS}.estimation", "second_starts", no_values),),
    "second starts, zero": ((f"{PLANTS}.second_starts", "_inside", no_values),),
    "second starts, excess": (
        (f"{PLANTS}.second_starts", "_excess_again", no_values),
        (f"{PLANTS}.second_starts", "_friction_exchanged", no_values),
    ),
    "second starts, delays": ((f"{PLANTS}.second_starts", "_other_delays", no_values),),
    "second starts, knees": ((f"{PLANTS}.second_starts", "_other_knees", no_values),),
    "second starts, lag": ((f"{PLANTS}.second_starts", "_lag_exchanged", no_values),),
    "restarts": ((f"{PLANTS}.estimation", "begun_again", as_reached),),
    "held": ((f"{PLANTS}.estimation", "held_as_seen", as_reached),),
    "initial states": ((f"{PLANTS}.estimation", "_begun_as_seen", lambda task, reached, *_: (task, reached)),),
    "straight command": ((f"{PLANTS}.estimation", "straight_if_better", as_reached),),
    "first look at starts": ((f"{PLANTS}.estimation", "_promising", lambda _, starts: starts[0]),),
    "scan of a resonance": ((f"{PLANTS}.continuation", "_scan", lambda rough, *_: rough.plant),),
    "release": ((f"{PLANTS}.continuation", "_Rounds._release", refused),),
    "restarts of a choice": ((f"{PLANTS}.trials", "Trials.around", lambda _, trial, *__: trial),),
    "drift weighting": ((f"{PLANTS}.choice", "_Choice._weigh", refused),),
    "hold exchange": ((f"{PLANTS}.choice", "_Choice._exchange_hold", nothing),),
    "another system": ((f"{PLANTS}.choice", "_Choice._is_another_system", refused),),
    "exchange of moves": ((SEARCH, "_exchanged", nothing),),
    "second batch of moves": ((SEARCH, "BATCHES", 1),),
}  # fmt: skip
"""What can be switched off."""


@contextmanager
def without(mechanism: str) -> Iterator[None]:
    """The program with a mechanism switched off; `UNDISTURBED` leaves it as it is."""
    patches = []
    for module, path, other in MECHANISMS.get(mechanism, ()):
        owner: Any = import_module(module)
        *classes, name = path.split(".")
        for each in classes:
            owner = getattr(owner, each)
        patches.append(patch.object(owner, name, other))
    for each in patches:
        each.start()
    try:
        yield
    finally:
        for each in patches:
            each.stop()


def switched_off(mechanism: str, system: str, seed: int, models: str) -> Line:
    """Identify a simulated system without a mechanism."""
    with without(mechanism):
        return simulated(system, seed, models)


def row(name: str, lines: list[Line], undisturbed: Mapping[tuple[str, str, int], Line]) -> list[str]:
    """The distribution without a mechanism, and how errors change."""
    ratios = np.array([np.inf if line.ratio is None else line.ratio for line in lines])
    both = [(line.error, undisturbed[line.key].error) for line in lines if line.key in undisturbed]
    changes = np.array(
        [(np.inf if a is None else a) / (np.inf if b is None else b) if a != b else 1.0 for a, b in both]
    )
    small, large = (f"{pick(changes):.3f}" if len(changes) else "" for pick in (np.min, np.max))
    return [
        name,
        f"{np.median(ratios):.3f}",
        f"{np.quantile(ratios, 0.9, method='lower'):.3f}",
        f"{np.sum(ratios <= WITHIN)} of {len(lines)}",
        str(sum(line.verdict == SUPPORTED for line in lines)),
        str(sum(line.wrong for line in lines)),
        str(np.sum(np.abs(changes - 1) > CHANGED)),
        small,
        large,
        f"{sum(line.seconds for line in lines):.0f}",
    ]


def main() -> None:
    """Measure what is asked for and print the table."""
    parser = parser_of(__doc__)
    known = ", ".join(MECHANISMS)
    parser.add_argument("mechanisms", nargs="*", metavar="MECHANISM", help=f"one of: {known} (default: all)")
    parser.add_argument("--only", default="", help="systems whose family or name contains this text, or several with |")
    parser.add_argument("--models", default="", help="fit only these, such as rigid-motor,arx")
    parser.add_argument("--seeds", type=numbers, default="0", help="such as 0-2 or 0-2,61 (default: 0)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="a folder for a file of every row")
    parser.add_argument("--jobs", type=int, default=1, help="systems at the same time (default: 1)")
    options = parser.parse_args()
    for name in options.mechanisms:
        if name not in MECHANISMS:
            parser.error(f"there is no mechanism {name}; name some of {known}")
    if options.out:
        options.out.mkdir(parents=True, exist_ok=True)
    parts = options.only.split("|")
    systems = [(f, name) for name, (f, _) in SYSTEMS.items() if any(part in f"{f}: {name}" for part in parts)]
    if not systems:
        parser.error(f"no system is called {options.only}; there are {', '.join(SYSTEMS)}")
    asked = [(family, name, seed) for seed in options.seeds for family, name in systems]
    board = Table(title="Without a mechanism", title_justify="left")
    heads = ("within", "supported", "wrong", "changed", "smallest", "largest", "CPU s")
    for head in ("without", "median", "90 %", *heads):
        board.add_column(head, justify="left" if head == "without" else "right")
    undisturbed: dict[tuple[str, str, int], Line] = {}
    for mechanism in (UNDISTURBED, *(options.mechanisms or MECHANISMS)):
        file = options.out / f"{mechanism}.json" if options.out else None
        done = {line.key: line for line in read(file)} if file else {}
        lines = [done[key] for key in asked if key in done]
        todo = [partial(switched_off, mechanism, key[1], key[2], options.models) for key in asked if key not in done]
        lines += measured(todo, options.jobs, file) if todo else ()
        if not lines:
            continue
        undisturbed = undisturbed or {line.key: line for line in lines}
        board.add_row(*row(mechanism, lines, undisturbed))
    console.print(board)


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # of the processes; CPU time would count threads that wait
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    main()
