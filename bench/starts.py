"""Whether a search ends at the same minimum from wherever it begins: ``python bench/accuracy.py starts``.

Every plant is fitted with its true structure from twenty starts: one without any datasheet, the others with every value
off by a factor between a half and two. Of a simulated plant the cost of the true run is known too. Name the
plants whose names begin like that to fit only these: ``python bench/accuracy.py "starts=axis 1"``.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from math import inf
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

import emsid
from emsid.errors import EmsidError
from emsid.models.plants.registry import PLANTS
from emsid.plants import DrivenPlant, simulation_error
from independent.cases import Case, named

STARTS, ALIKE = 20, 0.01
BRIDGES = ("testBench_testAll_10ms", "testBench_test_8Bul_10ms", "testBench_test_0BulFree_10ms")


class Problem(NamedTuple):
    """A record and the structure that is fitted to it.

    Attributes:
        record: to fit.
        start: a plant to begin with where nothing is known.
        known: typical values of what is estimated: the true ones, where these are known.
        fixed: what is not estimated.
        truth: the cost of the true free run, where it is known.
    """

    record: emsid.Record
    start: DrivenPlant
    known: Mapping[str, float]
    fixed: Mapping[str, float]
    truth: float | None = None


def of_case(case: Case) -> Problem:
    """A simulated plant with its own structure, its mass such that the drive makes one newton per unit."""
    truth, dt = case.truth, case.fitted.dt
    kind = "linear-axis" if case.shows_position else "rigid-motor"
    friction = "friction" if case.shows_position else "rotor_friction"
    if case.shows_position:
        mass, fixed = 1 / truth.gain, {}
        known = {"mass": mass, **_sides("viscous_friction", truth.viscous, mass)}
    else:
        fixed = {"resistance": 1.0, "rotor_viscous": 0.0}
        constant = truth.damping / truth.gain
        mass = constant / truth.gain
        known = {"motor_constant": constant, "rotor_inertia": mass, "voltage_dead_zone.half_width": truth.dead_zone}
    known |= _sides(f"{friction}.coulomb", truth.coulomb, mass)
    if any(truth.stribeck):
        known |= _sides(f"{friction}.stribeck", truth.stribeck, mass)
        known[f"{friction}.stribeck_rate"] = 1 / truth.stribeck_speed
    if truth.coasting:
        known["drive.freewheel"], fixed["drive.supply"] = truth.coasting, truth.full
    optional = {"drive.delay": truth.delay, ("offset" if case.shows_position else "load_torque"): mass * truth.offset}
    known |= {name: value for name, value in optional.items() if value}
    unit = "m" if case.shows_position else "rad/s"
    record = emsid.Record(case.fitted.input, case.fitted.output, dt, output_units=unit)
    cost = 0.5 * len(record) * case.error_of_truth(case.fitted) ** 2
    return Problem(record, PLANTS[kind].start, known, fixed, cost)


def _sides(name: str, pair: tuple[float, float], mass: float) -> dict[str, float]:
    """A value for both directions, or one for each where they differ."""
    if pair[0] == pair[1]:
        return {name: mass * pair[0]}
    return {f"{name}.forward": mass * pair[0], f"{name}.backward": mass * pair[1]}


def recordings(folder: Path) -> dict[str, Callable[[], Problem]]:
    """What the folder has, each with the parameters that such a plant usually has free, at values of a first fit."""

    def recording(kind: str, fixed: Mapping[str, float], read: Callable[[], emsid.Record]) -> Problem:
        record, start = read(), PLANTS[kind].start
        fit = simulation_error(start, record, fixed=fixed, max_iterations=30)
        return Problem(record, start, dict(zip(fit.names, fit.estimate.tolist(), strict=True)), fixed)

    found: dict[str, Callable[[], Problem]] = {
        "EMPS": lambda: recording("linear-axis", {}, lambda: emsid.read(
            folder / "emps" / "DATA_EMPS.mat", input="vir", output="qm", time="t", scale={"vir": 35.15065}
        )),
    }  # fmt: skip
    for name in BRIDGES:
        file = folder / "dc_motor_bidirectional" / f"{name}.dat"
        found[name] = lambda file=file: recording("rigid-motor", {"resistance": 1.0}, lambda: emsid.read(  # type: ignore[misc]
            file, input="PWM", output="mVel", dt=0.010048, mask="abs(PWM) > 255"
        ))  # fmt: skip
    return found


def costs(problem: Problem, starts: int = STARTS) -> Iterator[float]:
    """The cost that each search ends at; the first begins without a datasheet."""
    rng, names = np.random.default_rng(5), tuple(problem.known)
    for number in range(starts):
        plant = problem.start.with_values(dict(problem.fixed))
        if number:
            plant = plant.with_values({name: value * 2 ** rng.uniform(-1, 1) for name, value in problem.known.items()})
        try:
            fit = simulation_error(plant, problem.record, free=names, fixed=problem.fixed, hold="zero")
            yield float(fit.cost)
        except EmsidError:
            yield inf


def main(folder: Path, begins: str, console: Console) -> None:
    """Print a row for every plant whose name begins like this, and how many searches ended at the same cost."""
    problems: dict[str, Callable[[], Problem]] = {
        name: (lambda make=make: of_case(make())) for name, make in named(begins).items() if "drift" not in name
    }
    problems |= {name: make for name, make in recordings(folder).items() if name.startswith(begins)}
    board = Table(title=f"Searches from {STARTS} starts, within {ALIKE:.0%} of the lowest cost", title_justify="left")
    for head in ("", "same", "worst / lowest", "without datasheet / truth", "worst / truth", "CPU s"):
        board.add_column(head, justify="right" if head else "left")
    same, short, total = 0, 0, 0
    for name, make in problems.items():
        try:
            problem = make()
        except emsid.FormatError:  # a recording that is not there
            continue
        before = time.process_time()
        found = np.array(list(costs(problem)))
        seconds = time.process_time() - before
        lowest, truth = float(found.min()), problem.truth
        alike = int(np.sum(found <= (1 + ALIKE) * lowest))
        ratios = ("", "") if truth is None else (f"{found[0] / truth:.4f}", f"{found.max() / truth:.4f}")
        board.add_row(name, f"{alike} of {len(found)}", f"{found.max() / lowest:.4f}", *ratios, f"{seconds:.1f}")
        same, total = same + alike, total + len(found)
        short += 0 if truth is None else int(np.sum(found > (1 + ALIKE) * truth))
    console.print(board)
    console.print(f"{same} of {total} searches end at the same cost; {short} end above the cost at the truth\n")
