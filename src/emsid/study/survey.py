"""The survey: other motors, other inputs and other records, and how large the paper's ratio gets.

It takes about two minutes, so its result for the default settings is kept in ``recorded.json``, which
``python bench/study.py`` writes. `survey` does it again.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from concurrent.futures import Executor
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

from emsid.estimation.nonlinear.control import FREE, Control
from emsid.io.files import packaged
from emsid.record import Record
from emsid.study.inputs import MANY, InputRow, over_inputs
from emsid.study.motors import FAMILY, MotorRow, compare
from emsid.study.readings import Largest, largest_ratios
from emsid.study.setup import Settings
from emsid.study.two_masses import TwoMassRow, two_mass_rows

RECORDED = "recorded.json"


@dataclass(frozen=True)
class Survey:
    """The result of the survey.

    Attributes:
        motors: a row for every motor of the family.
        inputs: a row for every model, over many inputs of the experiment.
        largest: the largest ratio of the paper's own models in every reading of its experiment.
        two_masses: the motor with its shaft on records that are not the simulator's own; empty for a rigid motor.
        recorded: whether it was read from the file of the package.
    """

    motors: tuple[MotorRow, ...]
    inputs: tuple[InputRow, ...]
    largest: tuple[Largest, ...]
    two_masses: tuple[TwoMassRow, ...] = ()
    recorded: bool = False

    def to_data(self) -> dict[str, Any]:
        """Everything in built-in types."""
        parts = {name: [asdict(row) for row in getattr(self, name)] for name in _ROWS}
        return {**parts, "recorded": self.recorded}


_ROWS: dict[str, Any] = {"motors": MotorRow, "inputs": InputRow, "largest": Largest, "two_masses": TwoMassRow}


def survey(
    settings: Settings,
    *,
    inputs: int = MANY,
    others: Mapping[str, Record] | None = None,
    executor: Executor | None = None,
    control: Control = FREE,
) -> Survey:
    """Do the survey.

    Args:
        settings: bench, sample time, duration and seed of all records; the motor of the inputs and of the two masses.
        inputs: how many pairs of inputs.
        others: further records of the settings' motor for the two masses, by a short description.
        executor: where motors and inputs are fitted, such as a `concurrent.futures.ProcessPoolExecutor`.
        control: when to stop, and where to report progress.

    Raises:
        Stopped: if it is stopped before its end.
    """
    in_turn: Iterable[MotorRow] = map(partial(compare, settings=settings, control=control), FAMILY)
    if executor is not None:
        in_turn = executor.map(partial(compare, settings=settings), FAMILY)
    rows = []
    for k, row in enumerate(in_turn):
        rows.append(row)
        control.doing(f"survey of motors: {row.meaning}", k + 1, len(FAMILY))
    masses = () if settings.motor.is_rigid else two_mass_rows(settings, others or {}, control)
    return Survey(
        tuple(rows),
        over_inputs(settings, inputs, control, executor),
        largest_ratios(settings.duration, control),
        masses,
    )


def recorded() -> Survey:
    """The survey of the default settings, from the file of the package."""
    data = packaged("emsid.study", RECORDED)
    parts = {name: tuple(kind(**row) for row in data[name]) for name, kind in _ROWS.items()}
    return Survey(**parts, recorded=True)
