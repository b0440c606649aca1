"""An oscillator whose spring hardens, written down in ten lines and fitted to a multisine.

    python hardening_spring.py

    y″ + 2ζω·y′ + ω²·(y + κ·y³) = ω²·u

The input goes on between its samples, as that of most analogue experiments does. Taken for held, the correct equation
misses by forty times the noise, so the plant says ``between="band-limited"``. A model without physics,
``emsid.feedback``, is fitted beside it. The figure, written to hardening-spring.svg, shows a short stretch of their
free runs, and the force of the spring with its 95 % band, beside the true one and that of a linear spring.
"""

from __future__ import annotations

import sys

import numpy as np
from numba import njit

import emsid
from emsid.plants import OwnPlant, Parameter, Signal

DT = 1 / 600  # s


@njit
def derivative(x, u, p):
    """Change of position and speed."""
    omega, zeta, kappa = p
    return np.array([x[1], omega**2 * (u[0] - x[0] - kappa * x[0] ** 3) - 2 * zeta * omega * x[1]])


@njit
def output(x, u, p):
    """The position."""
    return x[:1]


SPRING = OwnPlant(
    derivative,
    output,
    table=(
        Parameter("omega", "ω", "rad/s", "natural frequency at small amplitude"),
        Parameter("zeta", "ζ", "1", "damping ratio"),
        Parameter("kappa", "κ", "1", "hardening"),
    ),
    values=(400.0, 0.1, 1.0),  # a rough start
    states=2,
    steps=3,
    name="hardening spring",
    between="band-limited",
)
TRUTH = {"omega": 440.0, "zeta": 0.05, "kappa": 6.0}
NOISE = 1e-3


def experiment(seed: int, amplitude: float, samples: int = 2000) -> emsid.Record:
    """A random signal up to 180 Hz, known between its samples too, with a little noise on the position."""
    rng, t = np.random.default_rng(seed), np.arange(samples) * DT
    lines = 2 * np.pi * np.arange(1, 300) * 0.6
    force = amplitude * np.sin(np.outer(t, lines) + rng.uniform(0, 2 * np.pi, len(lines))).sum(axis=1)
    clean = SPRING.with_values(TRUTH).simulate(force[:, None], DT, np.zeros(2), (Signal.POSITION,))
    return emsid.Record(force, clean + NOISE * rng.standard_normal(clean.shape), DT, "force", "position", name="spring")


def main() -> tuple[emsid.Fit[emsid.PlantModel], emsid.Comparison]:
    """Fit one experiment with two models, and judge them on a larger input."""
    record, unseen = experiment(1, 0.004), experiment(2, 0.005)
    fit = emsid.fit(SPRING, record)
    print(fit)
    black_box = emsid.feedback(order=2, static="polynomial", size=5, maps=1, oversampling=2)
    comparison = emsid.compare(fit, emsid.fit(black_box, record), unseen)
    print(comparison)
    draw(comparison, fit, unseen)
    return fit, comparison


def draw(comparison: emsid.Comparison, fit: emsid.Fit[emsid.PlantModel], record: emsid.Record) -> None:
    """A stretch of the free runs, and the force of the spring (in units of displacement) with its band."""
    import matplotlib.pyplot as plt

    figure, (runs, force) = plt.subplots(1, 2, figsize=(10, 3.6), width_ratios=(2, 1), layout="constrained")
    shown = slice(1100, 1220)
    runs.plot(record.time[shown], record.output[shown], "o", color="0.6", markersize=4, label="measured")
    for each, style in zip(comparison.fits, ("-", "--"), strict=True):
        runs.plot(record.time[shown], each.model.simulate(record).output[shown], style, label=each.model.name)
    runs.set(xlabel="time in s", ylabel="position", title="Free runs on an experiment that no model has seen")

    y, kappa = np.linspace(-0.4, 0.4, 201), fit.names.index("kappa")
    low, high = fit.interval()[kappa]
    force.plot(y, y, ":", color="0.5", label="linear spring")
    force.plot(y, y + TRUTH["kappa"] * y**3, color="0.6", linewidth=5, label="truth")
    force.plot(y, y + fit.estimate[kappa] * y**3, label=fit.model.name)
    force.fill_between(y, y + low * y**3, y + high * y**3, alpha=0.4, label="95 % band")
    force.set(xlabel="position", ylabel="force over stiffness", title="The spring")
    for axes in (runs, force):
        axes.legend(frameon=False, fontsize="small")
        axes.grid(alpha=0.3)
    figure.savefig("hardening-spring.svg")
    plt.close(figure)


if __name__ == "__main__":
    try:
        main()
    except emsid.EmsidError as problem:
        sys.exit(str(problem))
