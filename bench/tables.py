"""The tables of accuracy and speed that the site and the README show: ``python bench/tables.py``.

Takes some seconds. Times are of the processor, so that other work on the machine counts little; each is the best of
several, with one thread of BLAS for all programs. Factors are of programs in one run. Packages of others are compared
where they are installed (extra ``bench``). The simulated records are those of ``emsid demo``, whose true values are
known. `bench/run.py` and `bench/accuracy.py` measure more, and take minutes.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from threadpoolctl import threadpool_limits

import emsid
from emsid.study.demonstration import AXIS, axis_record, circuit_record, motor_record

Array = NDArray[np.float64]
MANY, FEW = 200_000, 2_000
"""Samples for what is compiled, and for what is not."""


def seconds(run: Callable[[], object], repetitions: int = 3) -> float:
    """Processor time of the fastest of several runs, after one that does not count."""
    run()
    times = []
    for _ in range(repetitions):
        began = time.process_time()
        run()
        times.append(time.process_time() - began)
    return min(times)


def record_of(samples: int) -> emsid.Record:
    """A linear system of third order with noise."""
    rng = np.random.default_rng(0)
    u = rng.standard_normal(samples)
    y = lfilter([0.0, 0.1, 0.2, 0.1], [1, -1.2, 0.5, -0.1], u) + 0.01 * rng.standard_normal(samples)
    return emsid.Record(u, y, 0.001)


def speed() -> Iterator[tuple[str, str, float]]:
    """Task, program and seconds for a sample; 10 parameters."""
    record, structure = record_of(MANY), emsid.arx(na=5, nb=5)
    few = record[:FEW]
    matrix, target = structure.regression(few)
    whole, goal = structure.regression(record)
    model = emsid.fit(structure, record).model
    batch, run = "least squares", "free run"
    yield batch, "emsid", seconds(lambda: emsid.least_squares(structure, record, threads=1)) / MANY
    yield batch, "NumPy lstsq, without building the matrix", seconds(lambda: np.linalg.lstsq(whole, goal)) / MANY
    yield from recursions(record, structure, matrix, target)
    yield run, "emsid", seconds(lambda: model.simulate(record)) / MANY
    with suppress(ImportError):
        peer = sysidentpy_model(few)
        yield run, "SysIdentPy", seconds(lambda: peer.predict(X=few.input, y=few.output[:5]), 1) / FEW


def recursions(
    record: emsid.Record, structure: emsid.Structure, matrix: Array, target: Array
) -> Iterator[tuple[str, str, float]]:
    """Recursive least squares with equal work: every estimate is kept, with the same forgetting factor.

    statsmodels does not forget. Where only the last estimate is kept, which no other program offers, *emsid* takes
    samples in tiles.
    """

    def own(forgetting: float, history: bool) -> float:
        recursion = emsid.recursive_least_squares
        return seconds(lambda: recursion(structure, record, forgetting=forgetting, history=history)) / MANY

    yield "recursive, last estimate", "emsid, λ 0.999", own(0.999, history=False)
    recursion = "recursive, all estimates"
    yield recursion, "emsid, λ 0.999", own(0.999, history=True)
    with suppress(ImportError):
        from padasip.filters import FilterRLS

        yield recursion, "padasip, λ 0.999", seconds(lambda: FilterRLS(10, mu=0.999).run(target, matrix), 1) / FEW
    with suppress(ImportError):
        from sysidentpy.parameter_estimation import RecursiveLeastSquares

        theirs = RecursiveLeastSquares(lam=0.999)
        yield recursion, "SysIdentPy, λ 0.999", seconds(lambda: theirs.optimize(matrix, target[:, None]), 1) / FEW
    yield recursion, "emsid, λ 1", own(1.0, history=True)
    with suppress(ImportError):
        from statsmodels.regression.recursive_ls import RecursiveLS

        yield recursion, "statsmodels, λ 1", seconds(lambda: RecursiveLS(target, matrix).fit(), 1) / FEW


def sysidentpy_model(record: emsid.Record):
    """A fitted model of SysIdentPy with ten linear terms."""
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    basis, estimator = Polynomial(degree=1), LeastSquares()
    peer = FROLS(order_selection=False, n_terms=10, ylag=5, xlag=5, estimator=estimator, basis_function=basis)
    peer.fit(X=record.input, y=record.output)
    return peer


def accuracy() -> Iterator[tuple[str, float, float, float, str]]:
    """Parameter, true value, estimate, half of the 95 % interval, unit."""
    motor = emsid.Motor()
    known = {"resistance": motor.resistance, "rotor_viscous": motor.rotor_viscous + motor.load_viscous}
    start = emsid.plants.rigid_motor().with_values({"voltage_dead_zone.half_width": 0.1})  # so that it is estimated
    fit = emsid.fit(start, motor_record(), fixed=known, search=False)
    zone = motor.voltage_dead_zone
    truth = {
        "motor_constant": (motor.motor_constant, "N·m/A"),
        "rotor_inertia": (motor.rotor_inertia + motor.load_inertia, "kg·m²"),
        "voltage_dead_zone.half_width": (zone.b_r if zone else 0.0, "V"),
    }
    yield from rows(fit, "motor: ", truth)
    free = ["mass", "viscous_friction", "friction.coulomb", "offset"]
    truth = {
        "mass": (AXIS.mass, "kg"),
        "viscous_friction": (AXIS.viscous_friction[0], "N·s/m"),
        "friction.coulomb": (1.5, "N"),
        "offset": (AXIS.offset, "N"),
    }
    yield from rows(emsid.fit(emsid.plants.linear_axis(), axis_record(), free=free), "axis: ", truth)
    cascade = emsid.fit(emsid.wiener_hammerstein((1, 2), static="saturation"), circuit_record())
    truth = {"f.high": (1.0, "V"), "f.low": (-1.0, "V")}
    yield from rows(cascade, "circuit: ", truth)


def rows(
    fit: emsid.Fit, where: str, truth: dict[str, tuple[float, str]]
) -> Iterator[tuple[str, float, float, float, str]]:
    """The estimates of a fit beside the truth."""
    found = dict(zip(fit.names, zip(fit.estimate, fit.standard_error, strict=True), strict=True))
    for name, (true, unit) in truth.items():
        value, error = found[name]
        yield where + name, true, value, 1.96 * error, unit


def main() -> None:
    """Print both tables."""
    print(f"{'':38} {'true':>9} {'estimate':>10} {'±':>9}")
    for name, true, value, half, unit in accuracy():
        print(f"{name:38} {true:9.4g} {value:10.5g} {half:9.2g}  {unit}")
    print(f"\n{'10 parameters':24} {'':42} {'per sample':>10}")
    own = 0.0
    with threadpool_limits(1):  # processor time adds up over the threads of BLAS
        for task, program, taken in speed():
            mine = program.startswith("emsid")
            own = taken if mine else own
            slower = "" if mine else f"  ×{taken / own:,.0f}"
            print(f"{task:24} {program:42} {1e6 * taken:7.3f} µs{slower}")


if __name__ == "__main__":
    main()
