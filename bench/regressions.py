"""The default identification on simulated nonlinear systems: ``python bench/regressions.py SYSTEM=SEED …``.

The systems come from a simulator that is not the program's own (``tests/independent``). Every seed has other
parameters, inputs and noise; seed 0 has the usual parameters. `emsid.identify` runs without options on one record, and
all of its models are judged on others of another kind. Errors are multiples of the noise, which no model can do better
than. For the oscillators the equation of the simulator is fitted too. Where a sweep jumps from one branch of a
resonance to the other, small errors of all parameters move the jump; the fit of the equation shows by how much.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numba import njit
from rich.console import Console
from rich.table import Table

import emsid
from arguments import asked_parts
from emsid.estimation.nonlinear.control import Activity, Control
from emsid.plants import OwnPlant, Parameter

HOME = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(HOME / "tests"))
from independent.nonlinear_systems import SYSTEMS, System  # noqa: E402
from independent.process_noise import circuit  # noqa: E402

PROCESS_NOISE = "process noise"
SPREAD = 0.2
"""Standard deviation of the factors by which the parameters of the seeds above 0 differ from the usual ones."""

console = Console(width=150)


@njit
def spring_rate(x, u, p):
    """Change of position and speed: y″ + 2ζω·y′ + ω²·(y + α·y² + κ·y³) = ω²·u."""
    omega, zeta, alpha, kappa = p
    force = u[0] - x[0] - alpha * x[0] ** 2 - kappa * x[0] ** 3
    return np.array([x[1], omega**2 * force - 2 * zeta * omega * x[1]])


@njit
def position(x, u, p):
    """The position."""
    return x[:1]


OSCILLATOR = OwnPlant(
    spring_rate,
    position,
    table=(
        Parameter("omega", "ω", "rad/s", "natural frequency at small amplitude"),
        Parameter("zeta", "ζ", "1", "damping ratio"),
        Parameter("alpha", "α", "1", "difference between the sides"),
        Parameter("kappa", "κ", "1", "hardening"),
    ),
    values=(400.0, 0.1, 0.0, 1.0),  # a rough start
    states=2,
    steps=8,
    name="true equation",
    between="band-limited",
)
EQUATIONS = {"oscillator": OSCILLATOR, "asymmetric oscillator": OSCILLATOR}
"""Systems whose equation is fitted beside the default models."""


def run_error(model: emsid.Model, record: emsid.Record) -> float:
    """RMSE of the free run, in the unit of the output."""
    run = model.simulate(record)
    return float(np.sqrt(np.mean((record.output - run.output)[run.counted] ** 2)))


class Clock:
    """CPU seconds by model, from the reports of an identification."""

    def __init__(self) -> None:
        self.spent: dict[str, float] = {}
        self.model, self.begun = "", time.process_time()

    def __call__(self, activity: Activity) -> None:
        model = activity.doing.partition(" ")[0].rstrip(":,")
        if model != self.model:
            now = time.process_time()
            self.spent[self.model] = self.spent.get(self.model, 0.0) + now - self.begun
            self.model, self.begun = model, now


def identified(
    name: str,
    records: Sequence[emsid.Record],
    judges: Mapping[str, emsid.Record],
    noise: float,
    equation: OwnPlant | None = None,
) -> None:
    """The default models and the true equation, each in multiples of the noise on every record to judge on."""
    clock, start = Clock(), time.process_time()
    result = emsid.identify(list(records), control=Control(report=clock))
    seconds = time.process_time() - start
    clock(Activity(""))
    board = Table(title=f"{name}: {seconds:.0f} s CPU; RMSE over the noise {noise:.4g}", title_justify="left")
    for head in ("", *judges, "parameters", "s CPU", "ended"):
        board.add_column(head, justify="right" if head else "left")
    rows = [(f"{result.chosen.model.name} (recommended)", result.recommended, result.chosen)]
    rows += [(fit.model.name, fit.model, fit) for fit in result.fits]
    if equation is not None:
        own = emsid.fit(equation, list(records))
        rows.append((equation.name, own.model, own))
    for model, run, fit in rows:
        errors = [run_error(run, record) / noise for record in judges.values()]
        spent = clock.spent.get(model, float("nan"))
        board.add_row(model, *(f"{e:.2f}" for e in errors), str(len(fit.estimate)), f"{spent:.1f}", fit.ending.value)
    console.print(board)


def system(name: str, seed: int) -> System:
    """A simulated system of other parameters for every seed above 0."""
    return SYSTEMS[name](seed=seed, spread=SPREAD if seed else 0.0)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the systems that are asked for, by default all; ``system=3`` asks for seed 3 in place of 0."""
    for asked in asked_parts(__doc__, [*SYSTEMS, PROCESS_NOISE], arguments):
        name, _, seed = asked.partition("=")
        if name == PROCESS_NOISE:
            made = circuit(seed=int(seed or 0))
            identified(asked, made.fitted, made.unseen, made.noise)
        else:
            one = system(name, int(seed or 0))
            identified(asked, [one.fitted], one.unseen, one.noise, EQUATIONS.get(name))


if __name__ == "__main__":
    main()
