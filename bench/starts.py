"""Whether a search ends at the same minimum from wherever it begins: ``python bench/accuracy.py starts``.

Every plant is searched from twenty starts: one without any datasheet, the others with every value off by a factor
between a half and two. A simulated plant has its true structure, and the cost of its true run is known; a recording has
the refinements that are chosen for it. Where the load drifts, as the choice finds, the drift is integrated out: without
that, it is nearly all of the error. Name the plants whose names begin like that to search only these:
``python bench/accuracy.py "starts=axis 1"``, or take others by their seeds: ``"starts=motor 100-109"``.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from math import inf
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console

import emsid
from emsid.errors import EmsidError
from emsid.models.plants.free_run_error import Weighting, all_alike
from emsid.models.plants.parameters import parts
from emsid.models.plants.registry import PLANTS
from emsid.models.plants.search.estimation import searched
from emsid.plants import DrivenPlant, choose
from independent.cases import Case, named

STARTS, ALIKE = 20, 0.01
BRIDGES = {
    "bridge, testAll": ("testBench_testAll_10ms", 0.010048),
    "bridge, 8 bolts": ("testBench_test_8Bul_10ms", 0.010048),
    "bridge, free": ("testBench_test_0BulFree_10ms", 0.010048),
    "bridge, old, 10 ms": ("OldMot_19_12_29_speedDatasStepping_testStepping_dt10", 0.010048),
    "bridge, old, 2 ms": ("OldMot_19_12_29_speedDatasStepping_testStepping_dt2", 0.002),
}
LOOP = 5
"""The JGA25 log repeats every sample of a loop at 200 Hz so many times."""
SERVOMOTOR = {"prbs_1": "deg/s", "prbs_2": "deg/s", "prbs_3": "deg/s", "closed_loop_profile": "deg"}
"""The unit of the output in each record of the servomotor; under the controller it is the position."""


class Problem(NamedTuple):
    """A record and the structure that is fitted to it.

    Attributes:
        record: to fit.
        start: a plant to begin with where nothing is known.
        known: typical values of what is estimated: the true ones, where these are known.
        fixed: what is not estimated.
        truth: the cost of the true free run, where it is known.
        weighting: how errors count by their age.
    """

    record: emsid.Record
    start: DrivenPlant
    known: Mapping[str, float]
    fixed: Mapping[str, float]
    truth: float | None = None
    weighting: Weighting = all_alike


def of_case(case: Case) -> Problem:
    """A simulated plant with its own structure but no drift; its mass is such that the drive makes 1 N per unit."""
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


def _simulated(make: Callable[[], Case], drifts: bool) -> Problem:
    problem = of_case(make())
    return under_drift(problem) if drifts else problem


def under_drift(problem: Problem) -> Problem:
    """The same with the drift of the load that the choice finds, and the cost of the true parameters under it."""
    weighting = choose(problem.start, problem.record).weighting
    true = problem.start.with_values({**problem.fixed, **problem.known})
    names, few = tuple(problem.known), {"find_start": False, "max_iterations": 0}
    *_, there = searched(true, problem.record, free=names, hold=true.hold, weighting=weighting, **few)
    return problem._replace(truth=float(there.cost), weighting=weighting)


def _sides(name: str, pair: tuple[float, float], mass: float) -> dict[str, float]:
    """A value for both directions, or one for each where they differ."""
    if pair[0] == pair[1]:
        return {name: mass * pair[0]}
    return {f"{name}.forward": mass * pair[0], f"{name}.backward": mass * pair[1]}


def step_records(folder: Path) -> list[emsid.Record]:
    """The step records of the JGA25, at the rate of the loop whose samples the log repeats."""
    columns = {"input": "Commanded_PWM", "output": "Motor_Speed(RPM)", "time": "Timestamp(ms)"}
    files = sorted((folder / "dc_motor_jga25_steps").glob("*.csv"))
    if not files:
        raise emsid.FormatError(f"no step records in {folder}")
    whole = [emsid.read(file, **columns, units={"Motor_Speed(RPM)": "rpm"}) for file in files]
    return [
        emsid.Record(
            each.input[::LOOP], each.output[::LOOP], LOOP * each.dt, each.input_names, each.output_names,
            each.input_units, each.output_units, name=each.name,
        )
        for each in whole
    ]  # fmt: skip


def recordings(folder: Path) -> dict[str, Callable[[], Problem]]:
    """What the folder has of plants, each with the refinements that are chosen for it."""

    def recording(kind: str, fixed: Mapping[str, float], read: Callable[[], emsid.Record]) -> Problem:
        record, start = read(), PLANTS[kind].start
        assert isinstance(start, DrivenPlant)
        fit = choose(start, record, fixed=fixed)
        found = fit.model.plant
        known = dict(zip(fit.names, fit.estimate.tolist(), strict=True))
        taken = {name for name in known for name in (name, *parts(found, name))}
        other = {
            name: found.value(name)
            for name, handle in found.handles.items()
            if len(handle.paths) == 1 and name not in taken and found.value(name) != start.value(name)
        }
        return Problem(record, start.with_hold(found.hold), known, {**other, **fixed}, weighting=fit.weighting)

    def axis() -> emsid.Record:
        file = folder / "emps" / "DATA_EMPS.mat"
        return emsid.read(file, input="vir", output="qm", time="t", scale={"vir": 35.15065})

    def bridge(file: str, dt: float) -> emsid.Record:
        file = folder / "dc_motor_bidirectional" / f"{file}.dat"
        return emsid.read(file, input="PWM", output="mVel", dt=dt, mask="abs(PWM) > 255")

    def servomotor(name: str) -> emsid.Record:
        units = {"u": "V", "y": SERVOMOTOR[name]}
        return emsid.read(folder / "dc_motor_prbs" / f"{name}.csv", input="u", output="y", time="t", units=units)

    def steps() -> emsid.Record:
        return emsid.concatenate(step_records(folder)[::3])

    ohm = {"resistance": 1.0}
    found: dict[str, Callable[[], Problem]] = {"EMPS": partial(recording, "linear-axis", {}, axis)}
    for name, (file, dt) in BRIDGES.items():
        found[name] = partial(recording, "rigid-motor", ohm, partial(bridge, file, dt))
    for name in SERVOMOTOR:
        found[name] = partial(recording, "rigid-motor", ohm, partial(servomotor, name))
    found["JGA25"] = partial(recording, "rigid-motor", ohm, steps)
    return found


def costs(problem: Problem, starts: int = STARTS) -> Iterator[float]:
    """The cost that each search ends at; the first begins without a datasheet."""
    rng, names = np.random.default_rng(5), tuple(problem.known)
    for number in range(starts):
        plant = problem.start.with_values(dict(problem.fixed))
        if number:
            off = {name: value * 2 ** rng.uniform(-1, 1) for name, value in problem.known.items()}
            limits = {name: (plant.handles[name].lower, plant.handles[name].upper) for name in off}
            plant = plant.with_values({name: float(np.clip(value, *limits[name])) for name, value in off.items()})
        try:
            task = {"free": names, "fixed": problem.fixed, "hold": plant.hold, "weighting": problem.weighting}
            yield float(searched(plant, problem.record, **task)[2].cost)
        except EmsidError:
            yield inf


def main(folder: Path, begins: str, console: Console) -> tuple[int, int, int]:
    """Print a row for every plant whose name begins like this: how many of its searches end at the same cost.

    Returns how many do in all, how many end above the cost at the truth, and how many there were.
    """
    problems: dict[str, Callable[[], Problem]] = {
        name: partial(_simulated, make, "drift" in name) for name, make in named(begins).items()
    }
    problems |= {name: make for name, make in recordings(folder).items() if name.startswith(begins)}
    console.print(f"Searches from {STARTS} starts: how many end within {ALIKE:.0%} of the lowest cost; ratios of costs")
    console.print(f"{'':24}      same  worst/lowest  without datasheet/truth  worst/truth  CPU s")
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
        first, worst = ("", "") if truth is None else (f"{found[0] / truth:.4f}", f"{found.max() / truth:.4f}")
        console.print(
            f"{name:24}{alike:4} of {len(found)}{found.max() / lowest:14.4f}{first:>25}{worst:>13}{seconds:7.1f}"
        )
        same, total = same + alike, total + len(found)
        short += 0 if truth is None else int(np.sum(found > (1 + ALIKE) * truth))
    console.print(f"{same} of {total} searches end at the same cost; {short} end above the cost at the truth\n")
    return same, short, total
