"""One sample of a model from Python, by `emsid.start` and by `advance`: ``python bench/steps.py``, in ``make bench``.

Times are of the processor, each the least of many short runs, as other work on the machine disturbs some of them. A
controller at 10 kHz has 100 µs for everything; the limit for a model of every kind is 10 µs.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from rich.console import Console

import emsid
from emsid.models.linear.polynomials import PolynomialModel
from emsid.models.linear.process_model import ProcessModel
from targets import Target, show

DT = 2e-3
SAMPLES, FEW, RUNS = 500, 100, 50
LIMIT = 10.0


def models() -> Iterator[tuple[str, Any]]:
    """A model of every kind, and of the plants with the most work for one sample."""
    rng = np.random.default_rng(0)
    arx = emsid.arx(na=5, nb=5)
    yield "arx, 10 parameters", emsid.RegressionModel(arx, 0.1 * rng.standard_normal(10), DT)
    friction = emsid.friction_narx(2, 2, knots=(-0.5, 0.5), speeds=(0.3,))
    yield "friction-narx", emsid.RegressionModel(friction, 0.1 * rng.standard_normal(len(friction)), DT)
    a = 0.4 * np.eye(4) + 0.1
    b, c = np.ones((4, 1)), np.ones((1, 4))
    yield "state-space, order 4", emsid.StateSpaceModel(a, b, c, np.zeros((1, 1)), 0.1 * b, np.zeros(1), DT)
    none, flat = np.zeros(0), np.zeros((1, 0))
    yield "armax", PolynomialModel([-1.2, 0.4], [[0.1, 0.05]], [-0.9, 0.25], none, flat, 0.1, 2, DT)
    yield "process model", ProcessModel(2.0, (0.08, 0.03), 0.01, 2.4 * DT, 0.1, DT)
    fast, slow = emsid.blocks.Rational([0.3], [-0.7]), emsid.blocks.Rational([0.0, 0.2, 0.1], [-1.1, 0.4])
    zone = emsid.blocks.DeadZone(-0.3, 0.2)
    for rate in (1, 2):
        yield f"wiener-hammerstein, oversampling {rate}", emsid.Cascade((fast, zone, slow), oversampling=rate, dt=DT)
    loop = np.array([[0.8, 0.2, 0.3, 0.1], [-0.2, 0.7, 0.1, -0.2], [1.0, 0.3, 0.2, 0.0], [1.0, 0.1, 0.05, 0.1]])
    yield "feedback", emsid.FeedbackModel(loop, (zone,), dt=DT)
    yield "rigid motor", emsid.PlantModel(emsid.plants.rigid_motor(), (emsid.plants.Signal.SPEED,))
    yield "motor with shaft and inductance", emsid.PlantModel(emsid.plants.motor(), (emsid.plants.Signal.SPEED,))
    yield "linear axis", emsid.PlantModel(emsid.plants.linear_axis(), (emsid.plants.Signal.POSITION,))
    parameter = emsid.plants.Parameter
    pendulum = emsid.OwnPlant(
        lambda x, u, p: np.array([x[1], -p[0] * np.sin(x[0]) - p[1] * x[1] + u[0]]),
        lambda x, u, p: x[:1],
        (parameter("g", "g/l", "1/s^2", "gravity over length"), parameter("d", "d", "1/s", "damping")),
        (7.0, 1.0),
        2,
    )
    yield "own plant", emsid.PlantModel(pendulum, (emsid.plants.Signal.POSITION,))


def microseconds(run: Callable[[int], None], samples: int) -> float:
    """Processor time for a sample, of the fastest run, after one that does not count."""
    run(samples)
    times = []
    for _ in range(RUNS):
        began = time.process_time()
        run(samples)
        times.append(time.process_time() - began)
    return 1e6 * min(times) / samples


def main() -> None:
    """Measure and print."""
    inputs = (3.0 * np.sin(np.arange(SAMPLES) / 50)).tolist()
    found = []
    for name, model in models():
        running, state = emsid.start(model, dt=DT), model.at_rest(0.0, DT)

        def stepped(samples: int, running: emsid.Stepper = running) -> None:
            step = running.step
            for u in inputs[:samples]:
                step(u)

        def advanced(samples: int, model: Any = model, state: Any = state) -> None:
            for u in inputs[:samples]:
                _, state = model.advance(state, u)

        slow = microseconds(advanced, FEW)
        found.append(Target(f"{name}: µs for step; {slow:.0f} for advance", microseconds(stepped, SAMPLES), LIMIT))
    show(found, Console(width=120))


if __name__ == "__main__":
    main()
