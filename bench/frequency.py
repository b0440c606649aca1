"""Responses, transfer functions and flexible modes of simulated systems: ``python bench/frequency.py [PART]``.

- ``levels``: multisines through a filter behind a cubic map; the noise that is found over that which was added, and the
  distortion over that of 200 other realisations, in dB. Target: within 1 dB.
- ``response``, ``record``: `transfer_function` from a frequency response, and from a record, of a pair of lightly
  damped poles; the error of 100 fits in units of the Cramér–Rao bound, all parameters together. Target: at most 1.05.
  For an efficient estimate this number has a standard deviation of 0.035 and 0.032.
- ``gantry``: a rigid body and eight modes between 5 and 200 Hz of damping 0.5 %, by the default search. Targets: the
  largest error of a frequency 0.1 %; 60 s of CPU time.
- ``aircraft``: three outputs, twelve modes, a spring that hardens, by the default search. Target: a free-run error at
  most 1.2 times that of the true linear system, over a record with another input.
- ``size``: `state_space(10)` of one input, two outputs and 65,536 samples. Target: 20 s of CPU time.

Every case has a seed of its own, which follow ``--seed``.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.signal import cont2discrete

import emsid
from arguments import parser_of
from emsid import Record, StateSpaceModel, frequency_response, state_space

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from test_frequency_response import FULL, NOISE, PERIOD, experiments, in_db
from test_transfer_function import of_record, of_response, rms_over_bound

Array = NDArray[np.float64]
FITS, CASES, DT = 100, 3, 0.001
LEVEL = 0.02
"""White noise of an output, as a part of its deviation."""
SPRING = 0.02
"""The force of the spring, as a part of the input."""


def levels(seed: int) -> None:
    reference = frequency_response(experiments(200, seed, FULL, cubic=0.02))
    power = np.abs(np.fft.rfft(experiments(1, seed, FULL)[0].input[:PERIOD, 0]))[FULL] ** 2
    for k in range(seed + 1, seed + 6):
        found = frequency_response(experiments(8, k, FULL, cubic=0.02))
        noise = in_db(found.noise, NOISE**2 * PERIOD / power / 6 / 8)
        print(f"levels, {k}: noise {noise:+.2f} dB, distortion {in_db(found.distortion, reference.distortion):+.2f} dB")


def response(seed: int) -> None:
    print(f"response: {rms_over_bound([of_response(seed + k) for k in range(FITS)]):.3f} of the Cramér–Rao bound")


def record(seed: int) -> None:
    print(f"record: {rms_over_bound([of_record(seed + k) for k in range(FITS)]):.3f} of the Cramér–Rao bound")


def modal(frequency: Array, damping: float, rigid: float, output: Array) -> StateSpaceModel:
    """Modes that a force drives with equal shares, and a rigid body with friction; outputs (ny, 1 + modes) of speed."""
    blocks = [np.array([[0.0, w], [-w, -2 * damping * w]]) for w in 2 * np.pi * frequency]
    a, b = block_diag(-rigid, *blocks), np.r_[1.0, np.tile([0.0, 1.0], len(frequency))][:, None]
    c, none = np.zeros((len(output), len(a))), np.zeros((len(output), 1))
    c[:, 0], c[:, 2::2] = output[:, 0], output[:, 1:]
    a, b, *_ = cont2discrete((a, b, c, none), DT)
    return StateSpaceModel(a, b, c, none, np.zeros(c.T.shape), none[:, 0], DT)


def noisy(u: Array, y: Array, rng: np.random.Generator) -> Record:
    names = tuple(f"speed {k + 1}" for k in range(y.shape[1]))
    y = y + LEVEL * y.std(axis=0) * rng.standard_normal(y.shape)
    return Record(u, y, DT, "force", names, "N", ("m/s",) * len(names))


def held(rng: np.random.Generator, samples: int) -> Array:
    """A force that changes every second sample."""
    return np.repeat(rng.uniform(-1.0, 1.0, samples // 2 + 1), 2)[:samples, None]


def gantry(seed: int) -> None:
    for k in range(seed, seed + CASES):
        rng = np.random.default_rng(k)
        true = np.geomspace(5.0, 200.0, 8) * rng.uniform(0.93, 1.07, 8)
        model = modal(true, 0.005, 2.0, np.r_[1.0, rng.uniform(0.3, 1.0, 8)][None])
        u = held(rng, 20_000)
        began = time.process_time()
        result = emsid.identify(noisy(u, model.run(np.zeros(17), u)[0], rng))
        seconds = time.process_time() - began
        found = emsid.modes(result.recommended_fit or result.recommended)
        resonances = found.frequency[np.array(found.kind) == "resonance"]
        missed = [np.min(np.abs(resonances / f - 1), initial=1.0) for f in true]
        print(
            f"gantry, {k}: {result.recommended.name}, {len(resonances)} resonances, largest error of a frequency "
            f"{100 * max(missed):.3f} %, {seconds:.1f} s"
        )


def hardening(model: StateSpaceModel, u: Array, frequency: Array, share: float) -> tuple[Array, float]:
    """The run of a model with a spring at its force, against the cube of the deflection of all modes there.

    Args:
        model: that `modal` makes, with modes at these frequencies.
        u: (N, 1) the force.
        frequency: of its modes, in Hz.
        share: of the force of the spring in the input, both as standard deviations; or the constant of the spring as a
            negative number.

    Returns:
        The outputs, and the constant of the spring.
    """
    deflection = np.zeros(model.order)
    deflection[1::2] = 1 / (2 * np.pi * frequency)

    def run(strength: float) -> tuple[Array, Array]:
        x, rows, moved = np.zeros(model.order), [], []
        for each in u:
            rows.append(model.c @ x)
            moved.append((deflection @ x) ** 3)
            x = model.a @ x + model.b @ (each - strength * moved[-1])
        return np.array(rows), np.array(moved)

    strength = -share if share < 0 else share * float(u.std() / run(0.0)[1].std())
    return run(strength)[0], strength


def aircraft(seed: int) -> None:
    for k in range(seed, seed + CASES):
        rng = np.random.default_rng(k)
        true = np.sort(np.geomspace(5.0, 150.0, 12) * rng.uniform(0.95, 1.05, 12))
        model = modal(true, 0.01, 5.0, rng.uniform(-1.0, 1.0, (3, 13)))
        u, other = held(rng, 16_384), held(rng, 8192)
        seen, strength = hardening(model, u, true, SPRING)
        record, unseen = noisy(u, seen, rng), noisy(other, hardening(model, other, true, -strength)[0], rng)
        began = time.process_time()
        result = emsid.identify(record)
        seconds = time.process_time() - began
        errors = [
            np.sqrt(np.nanmean((each.simulate(unseen, 200).output - unseen.output) ** 2, axis=0))
            for each in (result.recommended, model)
        ]
        print(
            f"aircraft, {k}: {result.recommended.name}, error over that of the true linear system "
            f"{', '.join(f'{ratio:.2f}' for ratio in errors[0] / errors[1])}, {seconds:.1f} s"
        )


def size(seed: int) -> None:
    for k in range(seed, seed + CASES):
        rng = np.random.default_rng(k)
        model = modal(np.array([12.0, 31.0, 55.0, 90.0]), 0.01, 2.0, rng.uniform(0.3, 1.0, (2, 5)))
        u = held(rng, 65_536)
        data = noisy(u, model.run(np.zeros(9), u)[0], rng)
        for free_run in (False, True):
            began = time.process_time()
            fit = emsid.fit(state_space(10), data, free_run=free_run)
            kind = "free run" if free_run else "one step ahead"
            print(f"size, {k}: {kind}, {fit.ending.value}, {time.process_time() - began:.1f} s")


PARTS = {each.__name__: each for each in (levels, response, record, gantry, aircraft, size)}


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"one of {', '.join(PARTS)} (default: all)")
    parser.add_argument("--seed", type=int, default=51_000, help="the first of the seeds (default: 51000)")
    asked = parser.parse_args()
    for name in asked.parts or PARTS:
        if name not in PARTS:
            parser.error(f"there is no part {name}; name one of {', '.join(PARTS)}")
        PARTS[name](asked.seed)
        sys.stdout.flush()


if __name__ == "__main__":
    main()
