"""Whether a first look finds the columns, the clock and the sign: ``python bench/first_look.py [SEEDS]``.

Files of ten kinds are simulated, one of each kind for a seed; with odd seeds they have names, with even ones none. All
gains are positive. A file is right where its input, its output (a position, or the speed of the same motion) and its
clock are, and where no change of sign is proposed. A wrong one is unsure where the look says that it is (a role of a
confidence below `UNSURE`, or no command). The time for 2,000 rows of six columns is printed last.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

import emsid
from arguments import numbers, parser_of
from emsid.cli.commands.describe import proposals
from emsid.first_look import groups
from emsid.first_look.levels import UNSURE

Array = NDArray[np.float64]
Columns = Mapping[str, Array]


class Truth(NamedTuple):
    """A file: its columns, its clock, and the columns that are right as input and as output."""

    columns: Columns
    clock: str
    inputs: str
    outputs: str


def lagged(u: Array, tau: float, delay: int = 1) -> Array:
    """(N,) the response of first order with gain 1 to an input (N,), from rest; time constant and delay in rows."""
    pole = np.exp(-1 / tau)
    return np.asarray(lfilter([1 - pole], [1, -pole], np.r_[np.zeros(delay), u[: len(u) - delay]]))


def steps(rng: np.random.Generator, n: int, hold: int, size: float) -> Array:
    """(N,) random levels, each held for about as many rows."""
    lengths = rng.integers(hold // 2, 2 * hold, 2 * n // hold + 2)
    return np.repeat(rng.uniform(-size, size, len(lengths)), lengths)[:n]


def speed_of_motor(rng: np.random.Generator) -> Truth:
    """Voltage, speed, current and temperature of a motor."""
    n, tau = 1500, rng.uniform(5, 25)
    u = steps(rng, n, 40, 12.0)
    speed = 20 * lagged(u, tau) + rng.normal(0, 2, n)
    current = (u - speed / 20) / 2 + rng.normal(0, 0.05, n)
    warm = 25 + np.cumsum(current**2) * 1e-3 + rng.normal(0, 0.1, n)
    return Truth({"t": 0.005 * np.arange(n), "voltage": u, "current": current, "speed": speed, "temp": warm}, *_TVS)


_TVS = ("t", "voltage", "speed")


def position_loop(rng: np.random.Generator) -> Truth:
    """A reference, and the voltage by which a controller makes an angle follow it."""
    n, gain, tau, dt = 800, rng.uniform(150, 400), rng.uniform(0.05, 0.15), 0.01
    r = np.repeat(rng.choice([0.0, 90.0, 180.0, 270.0], n // 80 + 1), 80)[:n]
    u, y = np.zeros(n), np.zeros(n)
    angle = speed = 0.0
    proportional, damping = rng.uniform(0.03, 0.06), rng.uniform(0.001, 0.002)
    for k in range(n):
        y[k] = angle + rng.normal(0, 0.1)
        u[k] = np.clip(proportional * (r[k] - y[k]) - damping * speed, -6, 6)
        driven = gain * np.sign(u[k]) * max(abs(u[k]) - 0.2, 0.0)
        speed += dt / tau * (driven - speed)
        angle += dt * speed
    return Truth({"t": dt * np.arange(n), "r": r, "y": y, "u": u}, "t", "u", "y")


def square_wave(rng: np.random.Generator) -> Truth:
    """A duty that toggles, and a speed that answers in its row or a row later."""
    n, period = 400, int(rng.integers(16, 30))
    pwm = np.where(np.arange(n) // (period // 2) % 2 == 0, 255.0, 85.0)
    speed = 0.33 * lagged(pwm, rng.uniform(0.6, 8), int(rng.integers(0, 2))) + rng.normal(0, 1.5, n)
    return Truth({"time": 0.05 * np.arange(n), "pwm": pwm, "rpm": np.round(speed)}, "time", "pwm", "rpm")


def runs(rng: np.random.Generator) -> Truth:
    """Runs of one duty each, with uneven times that start again, a speed and a position."""
    rows = [(d, t, v, p) for d in (50.0, -30.0, 80.0, -60.0) for t, v, p in _run(rng, d)]
    duty, t, speed, position = np.array(rows).T
    return Truth({"duty": duty, "time": t, "speed": speed, "position": position}, "time", "duty", "speed position")


def _run(rng: np.random.Generator, duty: float) -> list[tuple[float, float, float, float]]:
    t = np.cumsum(rng.choice([0.005, 0.006, 0.007, 0.03], 70, p=[0.4, 0.3, 0.25, 0.05]))
    speed = 9 * duty * (1 - np.exp(-t / 0.06)) + rng.normal(0, 4, len(t))
    return list(zip(t, np.round(speed), np.round(np.cumsum(np.diff(t, prepend=0) * speed)), strict=True))


def stand(rng: np.random.Generator) -> Truth:
    """A thrust stand: pulse width, thrust, current, and a battery that sags."""
    n = 900
    pulse = 1000 + 10 * np.round(np.abs(steps(rng, n, 45, 100.0)))
    share = (pulse - 1000) / 1000
    thrust = 800 * lagged(share**2, rng.uniform(2, 8)) + rng.normal(0, 4, n)
    current = 20 * lagged(share**2, 3.0) + rng.normal(0, 0.1, n)
    columns = {"Time (s)": 0.05 * np.arange(n), "ESC (µs)": pulse, "Voltage (V)": 12.4 - 0.1 * current}
    return Truth({**columns, "Current (A)": current, "Thrust (gf)": thrust}, "Time (s)", "ESC (µs)", "Thrust (gf)")


def axes(rng: np.random.Generator) -> Truth:
    """References and positions of two axes, which follow them."""
    n = 600
    columns: dict[str, Array] = {"timestamp_us": 5e7 + 2e4 * np.arange(n) + np.round(rng.uniform(-500, 500, n))}
    tau = rng.uniform(4, 10)
    for axis in "xy":
        columns[f"ref_{axis}"] = np.cumsum(lagged(steps(rng, n, 30, 0.2), 3.0))
    for axis in "xy":
        columns[f"pos_{axis}"] = 0.97 * lagged(columns[f"ref_{axis}"], tau, 1) + rng.normal(0, 0.02, n)
    return Truth(columns, "timestamp_us", "ref_x ref_y", "pos_x pos_y")


def motion(rng: np.random.Generator) -> Truth:
    """A force command, the speed and the position of one motion, in another order."""
    n = 1200
    u = steps(rng, n, 25, 1.0)
    speed = 3 * lagged(u, rng.uniform(10, 40), 2)
    position = np.cumsum(speed) * 0.01 + rng.normal(0, 1e-4, n)
    columns = {"position": position, "velocity": speed + rng.normal(0, 0.02, n), "command": u}
    return Truth({"time": 0.01 * np.arange(n), **columns}, "time", "command", "velocity position")


def late(rng: np.random.Generator) -> Truth:
    """A duty that acts after a long delay, and a first row of an earlier record."""
    n = 700
    u = steps(rng, n, 60, 80.0)
    t = 0.01 * np.arange(n)
    t[0] = 3.21
    speed = 6 * lagged(u, rng.uniform(5, 20), int(rng.integers(5, 25))) + rng.normal(0, 3, n)
    return Truth({"t": t, "duty": u, "Vs": np.full(n, 12.0), "omega": speed}, "t", "duty", "omega")


def wheels(rng: np.random.Generator) -> Truth:
    """Counts and duties of two wheels, which are driven differently."""
    n = 900
    duties = [np.round(steps(rng, n, 30, 100.0)) for _ in range(2)]
    counts = [np.round(2.7 * lagged(duty, rng.uniform(2, 6), 2) + rng.normal(0, 4, n)) for duty in duties]
    columns = {"speed1": counts[0], "speed2": counts[1], "duty1": duties[0], "duty2": duties[1]}
    return Truth({"time": 0.02 * np.arange(n), **columns}, "time", "duty1 duty2", "speed1 speed2")


def driven_by_torque(rng: np.random.Generator) -> Truth:
    """A smooth torque command, and the speed and the current of a joint with friction."""
    n = 1500
    torque = np.cumsum(lagged(rng.normal(0, 1, n), 20.0)) * 0.2
    torque -= np.linspace(0, torque[-1], n)
    speed = lagged(np.sign(torque) * np.maximum(np.abs(torque) - 0.1 * np.abs(torque).max(), 0), rng.uniform(8, 30))
    current = torque / 0.7 + rng.normal(0, 0.01 * np.abs(torque).max(), n)
    speed += rng.normal(0, 0.01 * np.abs(speed).max(), n)
    return Truth(
        {"t": 0.004 * np.arange(n), "torque": torque, "current": current, "speed": speed}, "t", _EITHER, "speed"
    )


_EITHER = "torque current"
KINDS: tuple[Callable[[np.random.Generator], Truth], ...] = (
    speed_of_motor,
    position_loop,
    square_wave,
    runs,
    stand,
    axes,
    motion,
    late,
    wheels,
    driven_by_torque,
)


def judged(truth: Truth, hidden: bool, path: Path) -> tuple[str, str]:
    """``right``, ``unsure``, ``wrong`` or ``wrong sign``, and what the look found."""
    called = dict(
        zip(truth.columns, (f"c{k + 1}" if hidden else name for k, name in enumerate(truth.columns)), strict=True)
    )
    rows = np.column_stack(list(truth.columns.values()))
    head = "" if hidden else ",".join(truth.columns) + "\n"
    path.write_text(head + "".join(",".join(f"{x:.10g}" for x in row) + "\n" for row in rows), encoding="utf-8")
    look = emsid.describe(path)
    named = {given: name for name, given in called.items()}
    u, y, t = (named.get(name, "") for name in (look.roles.input, look.roles.output, look.clock.column))
    commands = proposals(groups([look]))
    found = f"{u or '-'} -> {y or '-'}, clock {t or '-'}, delay {look.response.delay}, sign {look.response.sign:+d}"
    inputs, outputs = ([name for name in truth.columns if name in words] for words in (truth.inputs, truth.outputs))
    pair = u in inputs and y in outputs and (len(inputs) == 1 or len(outputs) == 1 or u[-1] == y[-1])
    unsure = min(look.roles.input_confidence, look.roles.output_confidence) < UNSURE or not commands
    if commands and any(option == "--scale" and "=-" in scale for option, scale in pairwise(commands[0])):
        return "wrong sign", found
    if pair and t == truth.clock and commands:
        return "right", found
    return ("unsure" if unsure else "wrong"), found


def main() -> None:
    """Print what was found in every file, the counts, and the time of a large look."""
    parser = parser_of(__doc__)
    parser.add_argument("seeds", nargs="?", type=numbers, default=range(4), help="numbers of files (0-3)")
    seeds = parser.parse_args().seeds
    counts = {hidden: Counter[str]() for hidden in (False, True)}
    with TemporaryDirectory() as folder:
        path = Path(folder, "log.csv")
        for kind in KINDS:
            for seed in seeds:
                hidden = seed % 2 == 0
                word, found = judged(kind(np.random.default_rng(seed)), hidden, path)
                counts[hidden][word] += 1
                print(f"{kind.__name__:16} {'hidden' if hidden else 'named':6} {word:10} {found}", flush=True)
        rng = np.random.default_rng(0)
        u = steps(rng, 2000, 40, 1.0)
        table = [0.01 * np.arange(2000), u, *(lagged(u, tau) + rng.normal(0, 0.1, 2000) for tau in (2, 5, 20, 50))]
        np.savetxt(path, np.column_stack(table), delimiter=",")
        begun = time.process_time()
        emsid.describe(path)
        seconds = time.process_time() - begun
    for hidden, found_of in counts.items():
        print(f"{'hidden' if hidden else 'named'}: {', '.join(f'{word} {n}' for word, n in found_of.most_common())}")
    print(f"2,000 rows of six columns: {seconds:.2f} s")


if __name__ == "__main__":
    main()
