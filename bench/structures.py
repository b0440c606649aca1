"""Whether the program finds the structure of motors of known structure: ``python bench/structures.py 0-19``.

Motors of even numbers are linear. For each of these the orders of the output-error model are compared with the true
ones, and its free run with that of the motor on another input: it is equivalent where they differ by less than 2 % of
the output. For every motor the table says whether the data are called nonlinear. The motors come from a simulator that
is not the program's own (``tests/independent``).
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

import emsid
from arguments import numbers, parser_of
from emsid.first_look.data_advice import advice
from emsid.validation.comparison import fit_percent

HOME = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(HOME / "tests"))
from independent.structures import Known, known  # noqa: E402

EQUIVALENT = 98.0
"""The least fit in % on another input without noise of a model that is equivalent to the motor."""


class Verdict(NamedTuple):
    """What the program found of a motor.

    Attributes:
        poles: of the output-error model; 0 where the motor is not linear.
        fit: of its free run on the other input, in %.
        called_nonlinear: what the data are called.
        seconds: CPU time.
    """

    poles: int
    fit: float
    called_nonlinear: bool
    seconds: float

    def right(self, motor: Known) -> bool:
        """Whether the linear model has the right order or is equivalent; true for a motor that is not linear."""
        return not motor.linear or self.poles == motor.order or self.fit > EQUIVALENT


def verdict(motor: Known) -> Verdict:
    """What the program finds of a motor."""
    begin = time.process_time()
    record = motor.record
    said = {finding.code for finding in advice(record)}
    poles, fit = 0, float("nan")
    if motor.linear:
        model = emsid.identify(record, models="output-error").fits[0].model
        poles = max((f.lag for r in model.structure.regressors for f in r.factors if not f.channel), default=0)
        run = model.simulate(motor.other)
        kept = run.counted
        fit = fit_percent(motor.other.output[kept], run.output[kept])
    return Verdict(poles, fit, "nonlinear-likely" in said, time.process_time() - begin)


def main(seeds: range) -> None:
    """Print the table of the motors with these seeds."""
    table = Table("motor", "poles", "found", "fit on another input %", "nonlinear", "said", "CPU s")
    motors = [known(seed) for seed in seeds]
    verdicts = [verdict(motor) for motor in motors]
    for seed, motor, found in zip(seeds, motors, verdicts, strict=True):
        table.add_row(
            str(seed),
            str(motor.order or "–"),
            str(found.poles or "–"),
            f"{found.fit:.2f}",
            "no" if motor.linear else "yes",
            "yes" if found.called_nonlinear else "no",
            f"{found.seconds:.1f}",
        )
    console = Console(width=110)
    console.print(table)
    of = [(m, v) for m, v in zip(motors, verdicts, strict=True) if m.linear]
    others = [v for m, v in zip(motors, verdicts, strict=True) if not m.linear]
    console.print(
        f"right orders or equivalent: {np.mean([v.right(m) for m, v in of]):.0%} of {len(of)}; called nonlinear: "
        f"{np.mean([v.called_nonlinear for v in others]):.0%} of those that are, "
        f"{np.mean([v.called_nonlinear for _, v in of]):.0%} of those that are not"
    )


if __name__ == "__main__":
    parser = parser_of(__doc__)
    parser.add_argument("seeds", nargs="?", type=numbers, default="0-19", help="of the motors (default: 0-19)")
    main(parser.parse_args().seeds)
