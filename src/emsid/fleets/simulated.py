"""A simulated fleet with known faults, for `emsid demo` and for the measurement of false alarms."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path

import numpy as np

from emsid.errors import DataError
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.excitation import amplitude_modulated_prbs
from emsid.io import atomic_write
from emsid.plant import Bench, Friction, Motor
from emsid.record import Record

SPREAD = 0.03
"""Standard deviation of every parameter between healthy motors: 3 %, as of motors of one type."""
WEAR, LOAD = 1.6, 1.5
"""Factors of the Coulomb friction of worn bearings, and of the inertia of the motor with another load."""
FAULTS = ("cut", "text", "silent")
"""What is wrong with the files that cannot be used: cut off, no table, and a motor that was never switched on."""


@dataclass(frozen=True)
class Simulated:
    """What was simulated: the motors by their fault; all others are healthy."""

    worn: tuple[str, ...]
    loaded: tuple[str, ...]
    poisoned: tuple[str, ...]


def simulated_fleet(
    folder: str | os.PathLike[str],
    motors: int = 40,
    samples: int = 5000,
    *,
    worn: int = 3,
    loaded: int = 1,
    poisoned: int = 3,
    seed: int = 1,
    control: Control = FREE,
) -> Simulated:
    """Write a fleet as Parquet files ``motor=M001/record.parquet`` with columns t, voltage and speed.

    Args:
        folder: where to.
        motors, samples: how many, and of each.
        worn, loaded, poisoned: how many have worn bearings, another load, and files that cannot be used.
        seed: of parameters, signals and noise.
        control: when to stop, and where to report progress.

    Raises:
        DataError: for more faults than motors.
    """
    if worn + loaded + poisoned > motors:
        raise DataError(f"{worn + loaded + poisoned} faults among {motors} motors; give fewer")
    rng = np.random.default_rng(seed)
    names = [f"M{k:0{len(str(motors))}d}" for k in range(1, motors + 1)]
    chosen = [names[k] for k in rng.permutation(motors)[: worn + loaded + poisoned]]
    made = Simulated(
        tuple(sorted(chosen[:worn])),
        tuple(sorted(chosen[worn : worn + loaded])),
        tuple(sorted(chosen[worn + loaded :])),
    )
    for k, name in enumerate(names):
        control.doing("simulating motors", k, motors)
        record = _record(name, made, samples, rng)
        content = _as_parquet(record)
        if name in made.poisoned:
            fault = FAULTS[made.poisoned.index(name) % len(FAULTS)]
            silent = replace(record, input=0 * record.input, output=0 * record.output)
            content = {"cut": content[: len(content) // 2], "text": b"no table\n", "silent": _as_parquet(silent)}[fault]
        atomic_write(Path(folder) / f"motor={name}" / "record.parquet", content)
    return made


def _record(name: str, made: Simulated, samples: int, rng: np.random.Generator) -> Record:
    usual = Motor()
    factor = 1 + SPREAD * rng.standard_normal(3)
    worn, loaded = name in made.worn, name in made.loaded
    friction = usual.rotor_friction
    assert isinstance(friction, Friction)
    level = float(np.mean(friction.coulomb))
    motor = replace(
        usual,
        rotor_friction=replace(friction, coulomb=level * factor[0] * (WEAR if worn else 1.0)),
        load_inertia=usual.load_inertia * factor[1] + (LOAD - 1) * loaded * (usual.rotor_inertia + usual.load_inertia),
        motor_constant=usual.motor_constant * factor[2],
    )
    voltage = amplitude_modulated_prbs(samples, 6, rng, 6.0, hold=20)
    return Bench.typical().run(motor, voltage, 0.005, rng)


def _as_parquet(record: Record) -> bytes:
    import polars as pl

    content = BytesIO()
    columns = {"t": record.time, "voltage": record.input[:, 0], "speed": record.output[:, 0]}
    pl.DataFrame(columns).write_parquet(content)
    return content.getvalue()
