"""A cascade of your own: filter, dead zone, filter, built block by block and fitted to a record.

    python cascade.py

The drive of a valve smooths its command, its gear has a dead zone, and the pipe behind it is slow:

    u → B₁(q)/A₁(q) → dead zone → B₂(q)/A₂(q) → y

The cascade is built with rough values and fitted to the free run; every block can be looked at afterwards. The figure
is written to cascade.svg.
"""

from __future__ import annotations

import sys

import numpy as np

import emsid
from emsid.blocks import Cascade, DeadZone, Rational

DT = 0.01  # s
TRUTH = Cascade(
    (Rational([0.3, 0.2], [-0.5]), DeadZone(-0.3, 0.2, 1.0, 1.0), Rational([0.0, 0.25], [-0.75])), name="valve"
)
START = Cascade(
    (Rational([0.2, 0.1], [-0.7]), DeadZone(-0.1, 0.1, 1.0, 1.0), Rational([0.0, 0.4], [-0.6])), name="valve"
)


def experiment(seed: int, samples: int = 3000) -> emsid.Record:
    """A record of the true cascade with 2 % of noise."""
    rng = np.random.default_rng(seed)
    command = np.repeat(rng.uniform(-1.5, 1.5, samples // 6), 6)
    flow = emsid.simulate(TRUTH, command, dt=DT).output[:, 0]
    noisy = flow + 0.02 * np.std(flow) * rng.standard_normal(samples)
    return emsid.Record(command, noisy, DT, "command", "flow", name=f"experiment {seed}")


def main() -> tuple[emsid.Fit[Cascade], emsid.Comparison]:
    """Fit the cascade and a linear model, and compare their free runs on another experiment."""
    train, test = experiment(1), experiment(2)
    fit = emsid.fit(START, train)
    print(fit)
    print(fit.model.equation())
    linear = emsid.fit(emsid.arx(na=2, nb=3), train)
    comparison = emsid.compare([fit, linear], test)
    print(comparison)
    emsid.compare([fit, linear], test[:500]).plot().savefig("cascade.svg")  # short enough to see the dead zone
    return fit, comparison


if __name__ == "__main__":
    try:
        main()
    except emsid.EmsidError as problem:
        sys.exit(str(problem))
