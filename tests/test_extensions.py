"""What a user adds without touching the package: a friction law and a plant."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray

import emsid
from emsid.errors import ModelError
from emsid.estimation.fit import Ending
from emsid.models.plants.registry import PLANTS
from emsid.plant.friction import FRICTION_LAWS
from emsid.plants import (
    DrivenMotor,
    FrictionLaw,
    Handle,
    LawParameter,
    LinearAxis,
    Measure,
    Parameter,
    Plant,
    PlantState,
    Signal,
    datasheet,
    friction_law,
    register,
    scalar,
)
from emsid.record import Record
from emsid.report.views.grey_box import friction, physical_table

Array = NDArray[np.float64]
DT = 5e-3
T = DT * np.arange(1500)
VOLTAGE = 3 * np.sin(2 * np.pi * 0.4 * T) + 2 * np.sin(2 * np.pi * 1.3 * T)


@pytest.fixture(autouse=True)
def _registries_as_before() -> Iterator[None]:
    laws, plants = dict(FRICTION_LAWS), dict(PLANTS)
    yield
    for registry, before in ((FRICTION_LAWS, laws), (PLANTS, plants)):
        registry.clear()
        registry.update(before)


# --- a friction law -------------------------------------------------------------------------------------------------


@njit
def rising(speed: float, numbers: Array, side: int) -> float:
    """α₀ + α₁·(1 − exp(−α₂·|ω|)): friction that grows with speed until the lubricant carries."""
    return numbers[side, 0] + numbers[side, 1] * (1.0 - np.exp(-numbers[side, 2] * speed))


@dataclass(frozen=True)
class Exponential(FrictionLaw):
    coulomb: float | tuple[float, float] = 0.01
    rise: float | tuple[float, float] = 0.0
    rate: float | tuple[float, float] = 0.1

    parameters: ClassVar = (
        LawParameter("coulomb", "α₀", Measure.FORCE, "Coulomb level"),
        LawParameter("rise", "α₁", Measure.FORCE, "rise of friction with speed"),
        LawParameter("rate", "α₂", Measure.PER_SPEED, "rate of the rise"),
    )
    level: ClassVar = rising


class Plain(Exponential):
    """The same law as a plain Python function."""

    level: ClassVar = rising.py_func


def motor_with(law: FrictionLaw) -> DrivenMotor:
    return DrivenMotor(
        emsid.Motor(
            inductance=0.0,
            voltage_dead_zone=None,
            rotor_friction=law,
            load_friction=emsid.Friction(),
            load_inertia=1e-12,
            load_viscous=0.0,
        ).rigid()
    )


TRUTH = motor_with(Exponential(6e-3, 5e-3, 0.06))
FREE = ("motor_constant", "rotor_inertia", *(f"rotor_friction.{name}" for name in ("coulomb", "rise", "rate")))


def measured(plant: DrivenMotor | LinearAxis, noise: float = 0.02, unit: str = "rad/s") -> Record:
    speed = plant.simulate(VOLTAGE[:, None], DT, np.zeros(2), (Signal.SPEED,))
    speed = speed + noise * np.random.default_rng(0).standard_normal(speed.shape)
    return Record(VOLTAGE, speed, DT, input_units=("V",), output_units=(unit,))


def test_a_friction_law_of_the_users_is_fitted_saved_and_shown(tmp_path):
    friction_law("exponential")(Exponential)
    start = motor_with(Exponential(1e-2, 2e-3, 0.1))
    fit = emsid.fit(start, measured(TRUTH), free=FREE)
    assert fit.ending is Ending.CONVERGED
    truth = np.array([TRUTH.value(name) for name in FREE])
    assert np.all(np.abs(fit.estimate - truth) < 4 * fit.standard_error)
    assert fit.estimate == pytest.approx(truth, rel=0.03)

    emsid.save(fit.model, tmp_path / "motor.json")
    loaded = emsid.load(tmp_path / "motor.json")
    assert loaded.plant == fit.model.plant

    table, *_ = physical_table(fit)
    rows = {row[0]: row for row in table.rows}
    assert rows["rotor_friction.rise"][1:5] == (
        "Rise of friction with speed on the rotor",
        "α₁m",
        "N·m",
        "assuming resistance, rotor_viscous",
    )
    figure = friction(fit)
    (line,) = [mark for mark in figure.plots[0].marks if getattr(mark, "label", "") == "friction torque"]
    expected = fit.model.plant.motor.rotor_friction.torque(line.x) + 1e-5 * line.x
    shown = np.isfinite(line.y)
    assert line.y[shown] / np.max(line.y[shown]) == pytest.approx(expected[shown] / np.max(expected[shown]), abs=1e-9)


def test_a_datasheet_names_the_law_whose_parameters_it_gives():
    friction_law("exponential")(Exponential)
    table = {"rotor_friction": {"law": "exponential", "rise": {"value": "5 mN*m", "tolerance": "20 %"}}}
    sheet = datasheet("motor", table)
    assert sheet["rotor_friction.rise"].limits == pytest.approx((4e-3, 6e-3))
    with pytest.raises(ModelError, match=r"no parameter 'rotor_friction\.rise'"):
        datasheet("motor", {"rotor_friction": {"rise": 1.0}})
    with pytest.raises(
        ModelError, match=r"no friction law 'dahl'; there are coulomb-stribeck, gaussian-stribeck, .*exponential"
    ):
        datasheet("motor", {"rotor_friction": {"law": "dahl"}})
    motor = emsid.Motor.from_dict({"rotor_friction": {"law": "exponential", "rise": "5 mN*m"}})
    assert motor.rotor_friction == Exponential(rise=5e-3)


def test_a_law_in_plain_python_gives_the_same_motion_as_a_compiled_one():
    plain = motor_with(Plain(6e-3, 5e-3, 0.06))
    compiled, slow = (each.simulate(VOLTAGE[:200, None], DT, np.zeros(2), (Signal.SPEED,)) for each in (TRUTH, plain))
    assert slow == pytest.approx(compiled, rel=1e-12, abs=1e-12)


def test_a_second_definition_of_the_papers_law_gives_the_same_motion():
    @njit
    def same(speed, numbers, side):
        return numbers[side, 0] + numbers[side, 1] * np.exp(-numbers[side, 2] * speed)

    @dataclass(frozen=True)
    class Again(FrictionLaw):
        coulomb: float = 0.0
        stribeck: float = 0.0
        stribeck_rate: float = 0.0
        parameters: ClassVar = emsid.Friction.parameters
        level: ClassVar = same

    law = (8e-3, 2e-3, 0.3)
    built_in, anew = (
        motor_with(kind(*law)).simulate(VOLTAGE[:, None], DT, np.zeros(2), (Signal.SPEED,))
        for kind in (emsid.Friction, Again)
    )
    assert np.array_equal(built_in, anew)


def test_a_law_on_an_axis_has_the_units_of_an_axis():
    axis = LinearAxis(mass=2.0, friction=Exponential(1.0, 2.0, 5.0))
    units = {name: handle.parameter.unit for name, handle in axis.handles.items()}
    assert units["friction.rise"] == "N"
    assert units["friction.rate.backward"] == "s/m"
    assert axis.default_free == ("mass", "viscous_friction", "friction.coulomb", "offset")


def test_a_law_that_is_not_registered_is_refused_where_it_would_be_lost(tmp_path):
    model = emsid.PlantModel(TRUTH, (Signal.SPEED,))
    with pytest.raises(ModelError, match="friction law Exponential is not registered"):
        emsid.save(model, tmp_path / "motor.json")
    assert not (tmp_path / "motor.json").exists()


def test_two_laws_on_one_mass_are_refused():
    motor = replace(TRUTH.motor, load_friction=Exponential())
    with pytest.raises(ModelError, match="a rigid motor has one friction law"):
        replace(TRUTH, motor=motor).simulate(VOLTAGE[:, None], DT, np.zeros(2), (Signal.SPEED,))


# --- a plant --------------------------------------------------------------------------------------------------------


@njit
def _swing(inertia: float, weight: float, damping: float, torque: Array, dt: float, x: Array, out: Array) -> None:
    """x = (angle, speed) through every sample by one Runge–Kutta step."""
    for k in range(len(torque)):
        out[k, 0] = x[0]
        a, v = x[0], x[1]
        a1, v1 = v, (torque[k] - weight * np.sin(a) - damping * v) / inertia
        b, w = a + 0.5 * dt * a1, v + 0.5 * dt * v1
        a2, v2 = w, (torque[k] - weight * np.sin(b) - damping * w) / inertia
        b, w = a + 0.5 * dt * a2, v + 0.5 * dt * v2
        a3, v3 = w, (torque[k] - weight * np.sin(b) - damping * w) / inertia
        b, w = a + dt * a3, v + dt * v3
        a4, v4 = w, (torque[k] - weight * np.sin(b) - damping * w) / inertia
        x[0] = a + dt / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        x[1] = v + dt / 6 * (v1 + 2 * v2 + 2 * v3 + v4)


HANDLES: Mapping[str, Handle] = {
    **scalar(("inertia",), Parameter("inertia", "J", "kg*m^2", "moment of inertia"), lower=1e-9),
    **scalar(("weight",), Parameter("weight", "G", "N*m", "largest torque of gravity"), Measure.FORCE),
    **scalar(("damping",), Parameter("damping", "D", "N*m*s/rad", "viscous friction"), Measure.DAMPING),
}


@dataclass(frozen=True)
class Pendulum(Plant):
    """J·dω/dt = T − G·sin(φ) − D·ω; input a torque, output the angle."""

    inertia: float = 0.01
    weight: float = 1.0
    damping: float = 0.01

    name: ClassVar[str] = "pendulum"
    states: ClassVar[int] = 2

    @property
    def handles(self) -> Mapping[str, Handle]:
        return HANDLES

    def run(self, state: PlantState, inputs: Array, signals: Sequence[Signal]) -> tuple[Array, PlantState]:
        x, out = state.motion.copy(), np.empty((len(inputs), 1))
        _swing(self.inertia, self.weight, self.damping, np.ascontiguousarray(inputs[:, 0]), state.dt, x, out)
        return out, state._replace(motion=x)


def swinging(plant: Pendulum) -> Record:
    torque = 0.2 * VOLTAGE
    angle = plant.simulate(torque[:, None], DT, np.array([0.3, 0.0]), (Signal.POSITION,))
    angle = angle + 2e-3 * np.random.default_rng(1).standard_normal(angle.shape)
    return Record(torque, angle, DT, input_units=("N*m",), output_units=("rad",))


def test_a_plant_of_the_users_is_fitted_saved_and_shown(tmp_path):
    register(Pendulum(), start=Pendulum(0.018, 1.3, 0.03), summary="a pendulum in a plane")
    truth = Pendulum(0.02, 1.5, 0.05)
    fit = emsid.fit(Pendulum(0.018, 1.3, 0.03), swinging(truth))
    assert fit.ending is Ending.CONVERGED
    assert fit.names == ("inertia", "weight", "damping")
    assert np.all(np.abs(fit.estimate - [0.02, 1.5, 0.05]) < 4 * fit.standard_error)
    assert fit.estimate == pytest.approx([0.02, 1.5, 0.05], rel=0.01)
    assert fit.states[0] == pytest.approx([0.3, 0.0], abs=0.02)

    emsid.save(fit.model, tmp_path / "pendulum.json")
    loaded = emsid.load(tmp_path / "pendulum.json")
    assert loaded.plant == fit.model.plant
    assert np.array_equal(loaded.simulate(fit.segments[0]).output, fit.model.simulate(fit.segments[0]).output)

    (table,) = physical_table(fit)
    assert [row[:5] for row in table.rows] == [
        ("inertia", "Moment of inertia", "J", "kg·m²", "estimated"),
        ("weight", "Largest torque of gravity", "G", "N·m", "estimated"),
        ("damping", "Viscous friction", "D", "N·m·s/rad", "estimated"),
    ]
    assert datasheet("pendulum", {"weight": "1.5 N*m"})["weight"].value == 1.5

    options = emsid.Options(fixed={"J": "0.02 kg*m^2"}, datasheet={"G": {"value": "1.4 N*m", "tolerance": "40 %"}})
    found = emsid.identify(swinging(truth), models="pendulum", options=options)
    assert found.chosen.names == ("weight", "damping")
    assert found.chosen.model.plant.inertia == 0.02
    assert found.chosen.estimate == pytest.approx([1.5, 0.05], rel=0.02)
    assert found.on_unseen.best.row.fit_percent > 95


def test_a_plant_that_is_not_registered_is_refused_where_it_would_be_lost(tmp_path):
    with pytest.raises(ModelError, match="pendulum is not registered"):
        emsid.save(emsid.PlantModel(Pendulum(), (Signal.POSITION,)), tmp_path / "pendulum.json")


def test_two_plants_of_one_name_are_refused():
    @dataclass(frozen=True)
    class Other(Pendulum):
        name: ClassVar[str] = "linear-axis"

    with pytest.raises(ModelError, match="there is a plant 'linear-axis' already"):
        register(Other())


# --- names as a person types them -----------------------------------------------------------------------------------


def test_a_parameter_is_found_by_its_symbol_and_its_value_with_a_unit():
    plant = motor_with(emsid.Friction(8e-3))
    record = measured(plant)
    fit = emsid.fit(plant, record, free=("K_m", "J_m", "rotor_friction.coulomb"), fixed={"R": "2 ohm"})
    assert fit.names == ("motor_constant", "rotor_inertia", "rotor_friction.coulomb")
    (resistance,) = [row for row in fit.table if row.name == "resistance"]
    assert (resistance.value, resistance.status) == (2.0, "fixed")
    with pytest.raises(ModelError, match="has several parameters 'J': rotor_inertia, load_inertia; give one of them"):
        emsid.fit(plant, record, free=("J",))
