"""What a file is, which a first look says first: a dynamic record, steady states, pulses, constant, or too short."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from emsid.first_look import describe
from emsid.first_look.kinds import FileKind, characteristic
from first_look_records import Run, Write, codes, data, proposals

Array = NDArray[np.float64]
Columns = dict[str, Array]


def curve(u: Array, dead: float, slope: float, limit: float) -> Array:
    """(N,) a speed that rests in a dead band, then rises with a slope, and saturates smoothly."""
    return np.asarray(limit * np.tanh(slope / limit * np.sign(u) * np.maximum(np.abs(u) - dead, 0)))


def dynamic(rng: np.random.Generator) -> Columns:
    """A motor with a clock."""
    n, tau = 300, rng.uniform(3, 10)
    u = np.repeat(rng.uniform(-6, 6, 15), 20)
    y = np.zeros(n)
    for k in range(1, n):
        y[k] = y[k - 1] + (20 * u[k - 1] - y[k - 1]) / tau
    return {"t": 0.01 * np.arange(n), "u": u, "y": y + rng.normal(0, 1, n)}


def states(rng: np.random.Generator) -> Columns:
    """Voltages in order and the speed at each; with an odd seed one direction only."""
    u = np.sort(rng.uniform(-5, 5, int(rng.integers(11, 120))))
    y = curve(u, 0.3, rng.uniform(100, 900), 700) + rng.normal(0, 0.5, len(u))
    return {"voltage": u, "speed": y}


def unnamed_states(rng: np.random.Generator) -> Columns:
    """The same of torque over speed, without names."""
    v = np.linspace(-0.3, 0.3, 2 * int(rng.integers(10, 40)))
    return {"c1": np.sign(v) * rng.uniform(1, 2) + 3 * v + rng.normal(0, 0.005, len(v)), "c2": v}


def pulses(rng: np.random.Generator) -> Columns:
    """The two levels of a photodiode behind a shaft of uneven speed, and a duty that does not drive it."""
    n = int(rng.integers(200, 600))
    speed = rng.uniform(0.1, 0.2) * (1 + 0.4 * np.sin(np.arange(n) * rng.uniform(0.01, 0.03)))
    high = np.cumsum(speed) % 1 < 0.5
    duty = np.where(np.arange(n) < 0.6 * n, 100.0, 0.0)
    return {"time_s": 2e-4 * np.arange(n), "encoder_V": np.where(high, 3.4, 2.0) + rng.normal(0, 0.02, n), "duty": duty}


def still(rng: np.random.Generator) -> Columns:
    """A drive that never moves."""
    return {"t": 0.01 * np.arange(200), "u": np.repeat(rng.uniform(-1, 1, 10), 20), "y": np.full(200, 12.0)}


def short(rng: np.random.Generator) -> Columns:
    """A record of thirty rows."""
    return {name: x[:30] for name, x in dynamic(rng).items()}


KINDS: dict[FileKind, tuple[Callable[[np.random.Generator], Columns], ...]] = {
    FileKind.DYNAMIC: (dynamic,),
    FileKind.STATES: (states, unnamed_states),
    FileKind.PULSES: (pulses,),
    FileKind.STILL: (still,),
    FileKind.SHORT: (short,),
}


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("kind", "made"), [(kind, made) for kind, each in KINDS.items() for made in each])
def test_kind(write: Write, kind: FileKind, made: Callable[[np.random.Generator], Columns], seed: int) -> None:
    """Only a dynamic record, and the count of pulses, have a proposed command."""
    look = describe(write(made(np.random.default_rng(seed))))
    assert look.kind.kind is kind, look.kind.evidence
    assert bool(proposals([look])) is (kind in (FileKind.DYNAMIC, FileKind.PULSES))
    assert ("steady-states" in codes(look)) is (kind is FileKind.STATES)
    assert ("encoder-pulses" in codes(look)) is (kind is FileKind.PULSES)


@pytest.mark.parametrize("seed", range(5))
def test_characteristic(seed: int) -> None:
    """Dead band, slope and saturation of a curve are found to the distance of its points."""
    rng = np.random.default_rng(seed)
    dead, slope, limit = rng.uniform(0.2, 0.6), rng.uniform(300, 900), rng.uniform(300, 700)
    u = np.linspace(-5, 5, 201)
    found = characteristic(u, curve(u, dead, slope, limit) + rng.normal(0, 0.2, len(u)))
    assert found["dead"] == pytest.approx([-dead, dead], abs=0.06)
    assert found["slope"] == pytest.approx(slope, rel=0.15)
    assert [found["low"][0], found["high"][0]] == pytest.approx([-limit, limit], rel=0.02)
    straight = characteristic(u, slope * u)
    assert (straight["dead"], straight["low"], straight["high"]) == (None, None, None)
    assert straight["slope"] == pytest.approx(slope)


@pytest.mark.parametrize("seed", range(3))
def test_a_command_of_two_levels_is_no_encoder(write: Write, seed: int) -> None:
    """A binary sequence drives the output, measured with noise, also without a name."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([-3.0, 3.0], 80), 5) + rng.normal(0, 0.05, 400)
    y = np.zeros(400)
    for k in range(1, 400):
        y[k] = 0.8 * y[k - 1] + u[k - 1]
    for u_name, y_name in (("voltage", "speed"), ("c2", "c3")):
        look = describe(write({"t": 0.01 * np.arange(400), u_name: u, y_name: y}))
        assert look.kind.kind is FileKind.DYNAMIC, look.kind.evidence


@pytest.mark.parametrize("seed", range(3))
def test_two_levels_beside_a_motor_are_no_encoder(write: Write, seed: int) -> None:
    """A counter whose last place toggles lies beside two wheels and their commands, all without names or a clock."""
    rng = np.random.default_rng(seed)
    columns = {"c5": np.cumsum(rng.random(400) < 0.97) % 2 * 4.0 + rng.choice([30.0, 31.0, 30.5], 400)}
    for wheel in (1, 2):
        u = np.repeat(rng.uniform(-60, 60, 40), 10)
        y = np.zeros(400)
        for k in range(1, 400):
            y[k] = 0.6 * y[k - 1] + 0.2 * u[k - 1]
        columns |= {f"c{wheel}": np.round(y + rng.normal(0, 0.5, 400)), f"c{wheel + 2}": np.round(u)}
    look = describe(write(columns))
    assert look.kind.kind is FileKind.DYNAMIC, look.kind.evidence
    assert (look.roles.input, look.roles.output) in {("c3", "c1"), ("c4", "c2")}


def test_a_moving_joint_without_a_clock_is_no_table(write: Write) -> None:
    """Its position never repeats, and torque and speed are no functions of it."""
    rng = np.random.default_rng(0)
    speed = 0.3 + rng.normal(0, 0.03, 200)
    torque = 2 + np.cumsum(rng.normal(0, 0.1, 200)) + rng.normal(0, 0.2, 200)
    look = describe(write({"c1": torque, "c2": np.cumsum(speed), "c3": speed}))
    assert look.kind.kind is FileKind.DYNAMIC
    assert "sample-time-unknown" in codes(look)


def test_said_first(write: Write, run: Run) -> None:
    """By describe in its first line, and by identify where it lacks columns; a given sample time makes it a record."""
    path = str(write(states(np.random.default_rng(3))))
    _, shown, _ = run("describe", path)
    assert "a table of steady states" in shown.splitlines()[0]
    status, _, problem = run("identify", path)
    assert status != 0
    assert "is a table of steady states" in problem
    assert describe(path, dt=0.01).kind.kind is not FileKind.STATES
    assert data(describe(path), "steady-states")["input"] == "voltage"
