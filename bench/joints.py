"""Joints in MuJoCo, identified from two records each and judged on a third: ``python bench/joints.py [0-11]``.

MuJoCo is independent of this program: its own time steps, gravity, damping, armature and ``frictionloss``; in every
third joint friction is the LuGre model (Canudas de Wit, Olsson, Åström, Lischinsky, IEEE TAC 40, 1995) as an applied
torque. A motor with a gear of 100 turns the joint, an encoder of 4,096 counts shows its angle every 5 ms. The record
that judges is of another kind: steps in place of sines.

MuJoCo's steps are of first order; with 25 µs, friction is still off by up to 0.9 half widths of its interval. So angles
are extrapolated to steps of no length, from 100 and 50 µs (Richardson): 2·θ(h/2) − θ(h).
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

import emsid
from arguments import numbers
from emsid.models.free_run import continued
from targets import Target, show

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
import independent.joint
from independent.joint import COUNTS, DT, GEAR

Array = NDArray[np.float64]
FINE = (50, 100)  # steps per sample
SAMPLES = 3000
BEGIN = 20  # samples that give the initial state


@dataclass(frozen=True)
class Joint(independent.joint.Joint):
    """A joint to simulate; all values are on its side of the gear."""

    bristles: bool = False

    @classmethod
    def drawn(cls, seed: int) -> Joint:
        """The joint with this number."""
        rng = np.random.default_rng(seed)
        weight, swing = rng.uniform(0.5, 3.0), rng.uniform(5.0, 9.0)
        return cls(
            weight / swing**2,
            rng.uniform(0.3, 0.8) * weight / swing,
            rng.uniform(0.05, 0.2) * weight,
            weight,
            rng.uniform(-0.5, 0.5),
            seed % 3 == 2,
        )


def mjcf(joint: Joint, fine: int) -> str:
    """The joint for MuJoCo: an arm of half of the inertia, the rest is armature."""
    length = 0.5 * joint.inertia * 9.81 / joint.weight
    mass = joint.weight / (9.81 * length)
    place = -length * np.sin(joint.angle), -length * np.cos(joint.angle)
    loss = 0.0 if joint.bristles else joint.friction
    return f"""
<mujoco><option timestep="{DT / fine}" gravity="0 -9.81 0" integrator="implicitfast"/><compiler angle="radian"/>
<worldbody><body><inertial pos="{place[0]} {place[1]} 0" mass="{mass}" diaginertia="1e-9 1e-9 1e-9"/>
<joint name="j" type="hinge" axis="0 0 1" armature="{joint.inertia - mass * length**2}" damping="{joint.damping}"
frictionloss="{loss}" solreffriction="{2 * DT / fine} 1"
solimpfriction="0.9999 0.9999 0.001 0.5 2"/></body></worldbody>
<actuator><motor joint="j" gear="{GEAR}"/></actuator></mujoco>"""


def commands(joint: Joint, kind: int) -> Array:
    """(N,) torque of the motor in N·m: sines of rising frequency, two sines, or steps."""
    t = DT * np.arange(SAMPLES)
    size = 0.5 * joint.weight + joint.friction
    if kind == 0:
        shape = np.sin(2 * np.pi * (0.1 * t + 0.04 * t**2))
    elif kind == 1:
        shape = 0.6 * np.sin(2 * np.pi * 0.31 * t) + 0.4 * np.sin(2 * np.pi * 1.13 * t)
    else:
        shape = np.repeat(np.random.default_rng(99).uniform(-1, 1, SAMPLES // 150 + 1), 150)[:SAMPLES]
    return size / GEAR * shape


def simulated(joint: Joint, kind: int) -> tuple[emsid.Record, Array]:
    """The record of a joint, and the angle without the encoder."""
    u = commands(joint, kind)
    coarse, fine = (turned(joint, u, steps) for steps in FINE)
    angle, size = 2 * fine - coarse, 2 * np.pi / COUNTS
    record = emsid.Record(
        u, np.round(angle / size) * size, DT, input_units="N*m", output_units="rad", name=f"{kind}"
    )  # fmt: skip
    return record, angle


def turned(joint: Joint, u: Array, fine: int) -> Array:
    """(N,) the angle at the samples of a command, by so many of MuJoCo's steps in each."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(mjcf(joint, fine))
    state = mujoco.MjData(model)
    state.qpos[0] = joint.angle
    bristle, stiffness = 0.0, 3e4 * joint.friction  # bristles of 3 mrad on the side of the motor
    angle = np.empty(len(u))
    for k, command in enumerate(u):
        angle[k] = state.qpos[0]
        state.ctrl[0] = command
        if not joint.bristles:
            mujoco.mj_step(model, state, fine)
            continue
        for _ in range(fine):  # bristles first, then the speed that they brake: their oscillation is not amplified
            speed = float(state.qvel[0])
            settled = math.copysign(joint.friction / stiffness, speed)
            bent = (settled - bristle) * -math.expm1(-stiffness * abs(speed) / joint.friction * DT / fine)
            bristle += bent
            state.qfrc_applied[0] = -stiffness * bristle - 0.1 * joint.friction * bent / (DT / fine)
            mujoco.mj_step(model, state)
    return angle


def judged(number: int) -> tuple[list[bool], float, dict[str, Any], float]:
    """Whether the interval of every value contains it, the error on the third record over the noise, details and s."""
    joint = Joint.drawn(number)
    records = [simulated(joint, kind)[0] for kind in (0, 1)]
    third, _ = simulated(joint, 2)
    begun = time.process_time()
    fit = emsid.fit(emsid.plants.joint(), records, fixed={"sensor.ratio": GEAR})
    spent = time.process_time() - begun
    intervals = {row.name: row.interval for row in fit.table}
    inside, values = [], {}
    for name, true in joint.truth.items():
        sides = [intervals[each] for each in (name, f"{name}.forward", f"{name}.backward") if each in intervals]
        inside.append(bool(sides) and all(low <= true <= high for low, high in sides))
        values[name] = (true, *[((low - true) / true, (high - true) / true) for low, high in sides])
    model = fit.model
    run = continued(model, model.initial(third, BEGIN), third, BEGIN)
    error = float(np.sqrt(np.mean((run - third.output[BEGIN:]) ** 2)))
    return inside, error / (2 * np.pi / COUNTS / np.sqrt(12)), values, spent


def main() -> None:
    """Print a line for every joint and the targets."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("joints", nargs="?", default="0-11", type=numbers)
    within, errors, times = [], [], []
    for number in parser.parse_args().joints:
        inside, error, values, spent = judged(number)
        within.append(all(inside))
        errors.append(error)
        times.append(spent)
        kind = "LuGre" if Joint.drawn(number).bristles else "frictionloss"
        outside = [name for name, yes in zip(values, inside, strict=True) if not yes]
        print(f"{number:3d} {kind:12s} error/noise {error:.3f}, {spent:.1f} s, outside: {', '.join(outside) or 'none'}")
        for name in outside:
            print(f"      {name}: {values[name]}")
    few = len(within) - 1
    targets = [
        Target("joints with every parameter within its interval", sum(within), few, least=True),
        Target("largest error on the third record over the noise of the encoder", max(errors), 1.3),
        Target("processor time of a fit in s, the longest", max(times), 30.0),
    ]
    show(targets, Console())


if __name__ == "__main__":
    main()
