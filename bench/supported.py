"""Whether models that are called supported are right: ``python bench/supported.py``.

Thirty plants of many kinds (``tests/independent/supported.py``) give a record each, from which ``emsid.identify``
recommends a model with its default options. The model then runs freely over a record of another kind of input, of 0.8
of its amplitude. The table has its error there over that of the true simulator, and the verdict on it. A model that is
more than `WITHIN` times worse than the truth is not supported by the data, so none may be called so.

``--only`` chooses plants by a part of their name, ``--seeds`` draws other parameters, inputs and noise, and ``--out``
writes the table as JSON.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

import emsid
from arguments import numbers, parser_of

HOME = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(HOME / "tests"))
from independent.supported import PLANTS  # noqa: E402

WITHIN = 1.3
"""The ratio of a model's error to that of the truth above which it may not be called supported."""
SUPPORTED = "model-supported"


@dataclass(frozen=True)
class Line:
    """A line of the table.

    Attributes:
        plant, seed: what was identified.
        model: the recommended one; empty where none is.
        parameters: how many were estimated.
        ratio: its error over that of the truth, on the record of another kind.
        best, best_ratio: the model of the table with the smallest error there.
        verdict: on the recommended model.
        reasons: against it.
        seconds: CPU time.
    """

    plant: str
    seed: int
    model: str
    parameters: int
    ratio: float
    best: str
    best_ratio: float
    verdict: str
    reasons: tuple[str, ...]
    seconds: float

    @property
    def wrong(self) -> bool:
        """Whether the verdict promises too much."""
        return self.verdict == SUPPORTED and not self.ratio <= WITHIN


def line_of(name: str, seed: int) -> Line:
    """Identify a plant."""
    case = PLANTS[name].pair(seed)
    before = time.process_time()
    result = emsid.identify(case.fitted)
    seconds = time.process_time() - before
    verdict, fit = result.model_verdicts[0], result.chosen
    models = [result.recommended, *(each.model for each in result.fits)]
    errors = [error(model, case.unseen) / case.noise for model in models]
    best = int(np.argmin(errors))
    reasons = tuple(each["code"] for each in verdict.data["reasons"])
    names = models[best].name, float(errors[best])
    return Line(name, seed, fit.model.name, fit.size, float(errors[0]), *names, verdict.code, reasons, seconds)


def error(model: emsid.Model, unseen: emsid.Record) -> float:
    """Root mean square error of the free run; infinite where it diverges."""
    rmse = float(emsid.compare(model, unseen).rows[0].simulation_rmse)
    return rmse if np.isfinite(rmse) else float("inf")


def main() -> None:
    """Print the table."""
    parser = parser_of(__doc__)
    parser.add_argument("--only", default="", help="plants whose name contains this text, or several with |")
    parser.add_argument("--seeds", type=numbers, default="0", help="such as 0-2 (default: 0)")
    parser.add_argument("--out", type=Path, help="a JSON file for the table")
    options = parser.parse_args()
    wanted = [name for name in PLANTS if any(part in name for part in options.only.split("|"))]
    if not wanted:
        parser.error(f"no plant is called {options.only}; there are {', '.join(PLANTS)}")
    console, lines = Console(width=170), list[Line]()
    for seed in options.seeds:
        for name in wanted:
            line = line_of(name, seed)
            lines.append(line)
            console.print(f"{line.plant}, {seed}: {line.model}, {line.ratio:.2f}, {line.verdict}", highlight=False)
            if options.out:
                options.out.write_text(json.dumps([asdict(each) for each in lines], indent=1), "utf-8")
    board = Table(title="Error on another kind of input over that of the truth", title_justify="left")
    for head in ("plant", "seed", "recommended", "parameters", "ratio", "best of all", "its ratio", "verdict", "CPU s"):
        board.add_column(
            head, justify="left" if head in ("plant", "recommended", "best of all", "verdict") else "right"
        )
    for each in lines:
        shown = f"{each.ratio:.2f}", each.best, f"{each.best_ratio:.2f}", each.verdict + " – wrong" * each.wrong
        board.add_row(each.plant, str(each.seed), each.model, str(each.parameters), *shown, f"{each.seconds:.0f}")
    console.print(board)
    supported = sum(each.verdict == SUPPORTED for each in lines)
    within, wrong = sum(each.ratio <= WITHIN for each in lines), sum(each.wrong for each in lines)
    console.print(
        f"{within} of {len(lines)} within {WITHIN:g} times the truth; "
        f"{supported} called supported, {wrong} of them wrong"
    )


if __name__ == "__main__":
    main()
