"""Accuracy of physical models in free run on records that they were not fitted to: ``python bench/accuracy.py``.

Simulated plants come from a simulator that is not the program's own (``tests/independent``). Real recordings are read
from the folder that the environment variable EMSID_RECORDINGS names, as in the tests; those that are missing are left
out. ``python bench/accuracy.py "simulated=axis with drift 100-109"`` takes plants of other seeds. The part
``regressions`` is that of ``bench/regressions.py``. The parts ``pairs`` and ``cascades`` take several CPU minutes,
``windows`` one, ``steps`` eight, ``starts`` twelve; name parts to print only these:
``python bench/accuracy.py emps``. The last table has the targets of all parts that were run.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

import emsid
import regressions
from arguments import asked_parts
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.search.estimation import searched
from emsid.plants import choose, linear_axis, rigid_motor

HOME = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(HOME / "tests"))
import cascades  # noqa: E402
import starts  # noqa: E402
import windows  # noqa: E402
from independent.cases import Case, named  # noqa: E402
from targets import Target, show  # noqa: E402

RECORDINGS = Path(os.environ.get("EMSID_RECORDINGS", HOME.parent / "shared" / "data"))
console = Console(width=150)


def table(title: str, *heads: str) -> Table:
    board = Table(title=title, title_justify="left")
    for k, head in enumerate(heads):
        board.add_column(head, justify="right" if k else "left")
    return board


def run_error(model: emsid.Model, record: emsid.Record) -> float:
    """RMSE of the free run, in the unit of the output."""
    run = model.simulate(record)
    return float(np.sqrt(np.mean((record.output - run.output)[run.counted] ** 2)))


def fit_percent(model: emsid.Model, record: emsid.Record) -> float:
    """100·(1 − ‖y − ŷ‖/‖y − ȳ‖) of the free run."""
    y = record.output[model.simulate(record).counted]
    return 100 * (1 - run_error(model, record) / float(np.std(y)))


def simulated(cases: Mapping[str, Callable[[], Case]]) -> list[Target]:
    """RMSE on an unseen record over that of the true parameters."""
    board = table(
        "Simulated plants: RMSE of the free run over that of the truth", "", "fitted", "unseen", "s", "refinements"
    )
    ratios = []
    for name, make in cases.items():
        case = make()
        unit = "m" if case.shows_position else "rad/s"
        known = emsid.Record(case.fitted.input, case.fitted.output, case.fitted.dt, output_units=unit)
        start = time.perf_counter()
        fit = choose(linear_axis() if case.shows_position else rigid_motor(), known)
        seconds = time.perf_counter() - start
        rows = []
        for record in (case.fitted, case.unseen):
            output = fit.model.plant.simulate(record.input, record.dt, np.zeros(3), fit.model.signals)
            rows.append(float(np.sqrt(np.mean((record.output - output) ** 2))) / case.error_of_truth(record))
        ratios.append(rows[1])
        board.add_row(name, *(f"{ratio:.3f}" for ratio in rows), f"{seconds:.1f}", ", ".join(fit.names))
    console.print(board)
    found = np.array(ratios)
    console.print(
        f"geometric mean {np.exp(np.mean(np.log(found))):.3f}; at most 1.3 in {np.sum(found <= 1.3)} of {len(found)}, "
        f"at most 2 in {np.sum(found <= 2)}; worst {found.max():.2f}\n"
    )
    return [
        Target(f"simulated plants, {len(found)}: % with an unseen RMSE of at most {most} times that of the truth",
               100 * float(np.mean(found <= most)), share, least=True)
        for most, share in ((1.3, 80), (2, 95))
    ]  # fmt: skip


def positioning_axis() -> list[Target]:
    """EMPS, the whole record fitted."""
    record = emsid.read(
        RECORDINGS / "emps" / "DATA_EMPS.mat", input="vir", output="qm", time="t", scale={"vir": 35.15065}
    )
    four = ("mass", "viscous_friction", "friction.coulomb", "offset")
    directional = ("mass", *(f"{name}.{side}" for name in ("viscous_friction", "friction.coulomb") for side in SIDES))
    ways: dict[str, Callable[[], emsid.Fit]] = {
        "four parameters": lambda: emsid.fit(linear_axis(), record, free=four),
        "by direction": lambda: emsid.fit(linear_axis(), record, free=directional),
        "chosen": lambda: choose(linear_axis(), record),
    }
    heads = ("", "RMSE, mm", "CPU s", "trusted for", "estimates ± half a 95 % interval")
    board = table("EMPS, fitted to the whole record, and its free run over it", *heads)
    targets = []
    for name, way in ways.items():
        start = time.process_time()
        fit = way()
        seconds = time.process_time() - start
        values = zip(fit.names, fit.estimate, fit.standard_error, strict=True)
        shown = ", ".join(f"{each} {value:.4g} ± {1.96 * error:.2g}" for each, value, error in values)
        error = 1e3 * run_error(fit.model, record)
        drifts = [each.data for each in fit.findings if each.code == "free-run-drifts"]
        trusted = [f"{data['seconds']:.2g} s, {1e3 * data['error']:.2f} mm" for data in drifts]
        board.add_row(name, f"{error:.2f}", f"{seconds:.1f}", ", ".join(trusted), shown)
        targets += [Target(f"EMPS, {name}: RMSE, mm", error, MOST[name]), Target(f"EMPS, {name}: CPU s", seconds, 10)]
        if tuple(fit.names) == four:
            inside = sum(low <= value <= high for value, (low, high) in zip(PUBLISHED, fit.interval(), strict=True))
            targets.append(Target(f"EMPS, {name}: 95 % intervals with the published value", inside, 4, least=True))
    console.print(board)
    return targets


MOST = {"four parameters": 3.0, "by direction": 2.1, "chosen": 2.1}
"""RMSE of EMPS in mm."""
PUBLISHED = (95.1089, 203.5034, 20.3935, -3.1648)
"""Mass, viscous and Coulomb friction and offset of EMPS, in SI units: Janot, Gautier, Brunot, *Data set and reference
models of EMPS*, Workshop on Nonlinear System Identification Benchmarks (2019)."""
SIDES = ("forward", "backward")
BRIDGE = {
    "testAll": ("testBench_testAll_10ms", 0.010048),
    "8 bolts": ("testBench_test_8Bul_10ms", 0.010048),
    "free": ("testBench_test_0BulFree_10ms", 0.010048),
    "old, 10 ms": ("OldMot_19_12_29_speedDatasStepping_testStepping_dt10", 0.010048),
    "old, 2 ms": ("OldMot_19_12_29_speedDatasStepping_testStepping_dt2", 0.002),
}


TOLD = {
    "units": {"PWM": "pwm", "mVel": "counts/sample"},
    "supply_voltage": 12.0,
    "counts_per_revolution": 621.0,
}
"""What the authors say of the records on an H-bridge; without it the two records of the old motor have two units."""


def pairs(which: Iterable[str] = BRIDGE) -> list[Target]:
    """Every record of the motors on an H-bridge fitted, and run on every other one, told nothing and told all."""
    targets = []
    for told, options in (("told nothing", {}), ("told pwm, 12 V, 621 counts per revolution", TOLD)):
        records = {
            name: emsid.read(
                RECORDINGS / "dc_motor_bidirectional" / f"{file}.dat",
                input="PWM",
                output="mVel",
                dt=dt,
                mask="abs(PWM) > 255",
                **options,
            )
            for name, (file, dt) in BRIDGE.items()
        }
        board = table(f"Bidirectional motors, {told}: fit of the free run in %, fitted in rows", "", *records, "CPU s")
        for name in which:
            start = time.process_time()
            fit = choose(rigid_motor(), records[name])
            seconds = time.process_time() - start
            fits = {other: fit_percent(fit.model, record) for other, record in records.items()}
            board.add_row(name, *(f"{each:.1f}" for each in fits.values()), f"{seconds:.1f}")
            if name == "testAll":
                what = f"bidirectional motor, {told}: testAll fitted, 8 bolts, fit in %"
                targets.append(Target(what, fits["8 bolts"], 95, least=True))
        console.print(board)
    return targets


FOLDS = 6


def steps(folds: int = FOLDS) -> list[Target]:
    """JGA25: each step record left out in turn.

    The structure is chosen ``FOLDS`` times, without the record and some others. The parameters are fitted without the
    record alone, from those of the choice, which has not seen it either. Rows are printed as they come. Of a record
    that stays at rest, which has no fit in %, the last choice is run, and the largest error is shown.
    """
    records = starts.step_records(RECORDINGS)
    moving = [k for k, record in enumerate(records) if np.ptp(record.output) > 0]
    console.print("JGA25: one step record left out in turn\n command  fit %  CPU s  of it for the choice")
    fits = []
    for fold in range(folds):
        out = moving[fold::FOLDS]
        start = time.process_time()
        chosen = choose(rigid_motor(), emsid.concatenate([r for k, r in enumerate(records) if k not in out]))
        choice = time.process_time() - start
        asked = [row.name for row in chosen.table if row.status != "fixed"]
        for k in out:
            start = time.process_time()
            rest = emsid.concatenate([*records[:k], *records[k + 1 :]])
            task, _, reached = searched(
                chosen.model.plant, rest, free=asked, find_start=False, hold=chosen.model.plant.hold
            )  # without intervals
            fits.append(fit_percent(GreyBox(reached.problem.plant, task.signals), records[k]))
            seconds = choice + time.process_time() - start
            console.print(f"{records[k].input[-2, 0]:8.0f}  {fits[-1]:5.1f}  {seconds:5.1f}  {choice:5.1f}")
            choice = 0.0
    resting = [record for k, record in enumerate(records) if k not in moving]
    errors = [float(np.max(np.abs(record.output - chosen.model.simulate(record).output))) for record in resting]
    console.print(
        f"{len(fits)} of {len(records)} moved: median fit {np.median(fits):.1f} %, worst {min(fits):.1f} %; "
        f"the others were at rest: largest error {max(errors):.1f} rad/s\n"
    )
    median, worst = float(np.median(fits)), min(fits)
    return [Target("JGA25: median fit in %", median, 94, True), Target("JGA25: worst fit in %", worst, 80, True)]


def searches(begins: str) -> list[Target]:
    """Searches from twenty starts; see `starts`."""
    same, short, total = starts.main(RECORDINGS, begins, console)
    if not total:
        return []
    return [
        Target("starts: % of searches within 1 % of the lowest cost", 100 * same / total, 95, least=True),
        Target("starts: searches more than 1 % above the cost at the truth", short, 0),
    ]


PARTS: dict[str, Callable[[str], list[Target] | None]] = {
    "simulated": lambda which: simulated(named(which)),
    "emps": lambda _: positioning_axis(),
    "pairs": lambda begins: pairs([name for name in BRIDGE if name.startswith(begins)]),
    "steps": lambda _: steps(),
    "regressions": lambda systems: regressions.main([systems] if systems else []),
    "cascades": lambda seeds: cascades.main(seeds, console),
    "starts": searches,
    "windows": lambda which: windows.main(which, console),
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the parts that are asked for, by default all; ``part=name`` asks for some cases of one."""
    targets: list[Target] = []
    for name in asked_parts(__doc__, PARTS, arguments):
        part, _, begins = name.partition("=")
        try:
            targets += PARTS[part](begins) or []
        except emsid.FormatError as problem:  # a recording that is not there
            console.print(f"{name}: {problem}")
    show(targets, console)


if __name__ == "__main__":
    main()
