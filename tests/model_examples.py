"""A model of every kind, and records of it, for the tests that hold for all of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from emsid import LinearAxis, MotorPlant, OwnPlant, Record
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational, fir
from emsid.models.blocks.static_maps import (
    Abs,
    CoulombLinear,
    CubicSpline,
    DeadZone,
    EvenSpline,
    HyperbolicTangent,
    MonotoneSpline,
    OddSpline,
    PiecewiseLinear,
    Polynomial,
    Saturation,
    StaticMap,
    TwoSlopes,
    UserMap,
)
from emsid.models.feedback.model import FeedbackModel
from emsid.models.linear.polynomials import PolynomialModel
from emsid.models.linear.process_model import ProcessModel
from emsid.models.linear.state_space import StateSpaceModel
from emsid.models.linear.transfer_function import TransferFunction
from emsid.models.model import Model
from emsid.models.plants.drive import Drive, Feed
from emsid.models.plants.gravity import Gravity
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.parameters import Signal
from emsid.models.plants.sensor import Sensor
from emsid.models.plants.servo import SERVO_STEPS, Servo
from emsid.models.regression.narx import Narx, Structure
from emsid.models.regression.structures import arx, friction_narx, wiener_hammerstein_regression
from emsid.plant import Friction, Motor, PowerFriction
from emsid.plant.motor import Parameter

Array = NDArray[np.float64]
DT = 0.01
SAMPLES = 160
KNOTS = np.array([-3.0, -1.0, 0.0, 1.5, 3.0])


MAPS: dict[str, StaticMap] = {
    "polynomial": Polynomial(np.array([0.2, 1.5, 0.1, 0.05])),
    "dead-zone": DeadZone(-0.35, 0.25, 0.7, 1.3),
    "two-slopes": TwoSlopes(0.3, 0.4, 1.5),
    "saturation": Saturation(1.7, -1.1, 0.9),
    "coulomb-linear": CoulombLinear(0.4, 1.2, width=0.3),
    "piecewise-linear": PiecewiseLinear(KNOTS, np.tanh(KNOTS)),
    "spline": CubicSpline(KNOTS, np.tanh(KNOTS)),
    "tanh": HyperbolicTangent(0.9, 0.5),
    "even-spline": EvenSpline(np.array([0.1, 1.0, 2.0]), np.array([0.2, 0.9, 2.2])),
    "odd-spline": OddSpline(np.array([0.5, 1.0, 2.0]), np.array([0.4, 0.9, 1.2])),
    "monotone-spline": MonotoneSpline(np.array([-1.0, 0.0, 1.5]), 0.3, np.array([0.2, -0.5, 0.1])),
    "abs": Abs(),
    "user": UserMap(
        lambda x, p: p[0] * np.cbrt(x),
        lambda x, p: p[0] / 3 / np.maximum(np.cbrt(x) ** 2, 1e-9),
        lambda x, p: np.cbrt(x)[None, :],
        np.array([1.3]),
    ),
}


FAST, SLOW = Rational([0.3], [-0.7]), Rational([0.0, 0.2, 0.1], [-1.1, 0.4], delay=1)
LOOP = np.array([[0.8, 0.2, 0.3, 0.1], [-0.2, 0.7, 0.1, -0.2], [1.0, 0.3, 0.2, 0.0], [1.0, 0.1, 0.05, 0.1]])


TWO_LOOPS = np.array(
    [
        [0.8, 0.2, 0.3, 0.1, -0.1],
        [-0.2, 0.7, 0.1, -0.2, 0.05],
        [1.0, 0.3, 0.2, 0.0, 0.0],
        [0.2, -0.5, 0.0, 0.0, 0.0],
        [1.0, 0.1, 0.05, 0.1, 0.0],
    ]
)


OWN = OwnPlant(
    lambda x, u, p: np.array([x[1], p[0] * u[0] - p[1] * x[1] - 4.0 * np.sin(x[0])]),
    lambda x, u, p: np.array([x[1]]),
    (Parameter("gain", "k", "1", "gain"), Parameter("damping", "d", "1/s", "damping")),
    (3.0, 2.0),
    states=2,
)


def regressions() -> Iterator[tuple[str, Narx]]:
    """Regressions with and without memory, constants and products."""
    for name, structure, parameters in (
        ("arx", arx(2, 2), [-1.2, 0.4, 0.1, 0.05]),
        ("finite impulse response", arx(0, 3, nk=0), [0.5, 0.3, 0.1]),
        ("no memory", Structure.parse("u(t)", "u(t)^2", "1"), [1.0, 0.2, 0.1]),
        (
            "paper's",
            wiener_hammerstein_regression(2, 2, 2, taps=2),
            [-1.2, 0.4, 0.1, 0.05, 0.02, 0.01, 0.02, 0.01, 0.01, 0.01],
        ),
        (
            "friction",
            friction_narx(2, 2, knots=(-0.5, 0.5), speeds=(0.3,)),
            [-1.2, 0.3, 0.1, 0.05, 0.02, 0.01, 0.03, 0.01, 0.01, 0.002, 0.003],
        ),
        ("bilinear", Structure.parse("y(t-1)", "y(t-2)*u(t-1)", "u(t-1)", "abs(y(t-1))^2"), [0.8, 0.02, 0.3, -0.01]),
    ):
        yield name, Narx(structure, np.array(parameters), DT)


def state_spaces() -> Iterator[tuple[str, StateSpaceModel]]:
    """State-space models of one output and of two, with and without a noise model."""
    a, b, c = np.array([[1.2, -0.4], [1.0, 0.0]]), np.array([[0.1], [0.05]]), np.array([[1.0, 0.5]])
    gain, none = np.array([[0.3], [0.1]]), np.zeros((2, 1))
    yield "state space", StateSpaceModel(a, b, c, np.zeros((1, 1)), gain, np.array([0.2]), DT)
    yield "state space without a noise model", StateSpaceModel(a, b, c, np.array([[0.3]]), none, np.zeros(1), DT)
    both, gains = np.vstack([c, [0.2, -0.1]]), np.array([[0.3, 0.1], [0.1, 0.2]])
    yield "state space, two outputs", StateSpaceModel(a, b, both, np.zeros((2, 1)), gains, np.array([0.2, -0.1]), DT)


def polynomials() -> Iterator[tuple[str, PolynomialModel]]:
    """Models in polynomials, with and without a noise model."""
    none, flat = np.zeros(0), np.zeros((1, 0))
    slow, fast = [-1.2, 0.4], [[0.1, 0.05]]
    yield "armax", PolynomialModel(slow, fast, [-0.9, 0.25], none, flat, 0.1, 2, DT)
    yield "box-jenkins", PolynomialModel(none, fast, [0.3], [-0.8], [slow], 0.1, 0, DT)
    yield "polynomials without noise model", PolynomialModel(none, fast, none, none, [slow], 0.0, 1, DT)


def transfer_functions() -> Iterator[tuple[str, TransferFunction]]:
    """Of s, resonant and late, and of z."""
    yield "transfer function", TransferFunction(np.array([3.0, 90.0]), np.array([1.0, 4.0, 90.0]), 0.0, 0.1, DT)
    yield "transfer function, late", TransferFunction(np.array([-20.0]), np.array([1.0, 10.0]), 2.4 * DT, 0.0, DT)
    yield (
        "transfer function of z",
        TransferFunction(np.array([0.2, 0.1]), np.array([1.0, -1.5, 0.6]), 2 * DT, 0.2, DT, discrete=True),
    )


def processes() -> Iterator[tuple[str, ProcessModel]]:
    """Process models with and without zero, whole and fractional dead times."""
    yield "process", ProcessModel(2.0, (0.08, 0.03), 0.0, 0.0, 0.1, DT)
    yield "process, late", ProcessModel(-2.0, (0.08,), 0.02, 2.4 * DT, 0.0, DT)
    yield "process, late by whole samples", ProcessModel(1.5, (0.05, 0.04, 0.02), -0.02, 3 * DT, 0.2, DT)


def cascades() -> Iterator[tuple[str, Cascade]]:
    """Cascades with every map, of every topology, with delays and oversampling."""
    for name, static in MAPS.items():
        yield f"wiener-hammerstein, {name}", Cascade((FAST, static, SLOW), 0.1, 0.2, dt=DT)
    bend = MAPS["polynomial"]
    yield "hammerstein", Cascade((bend, SLOW), dt=DT)
    yield "wiener", Cascade((SLOW, bend), dt=DT)
    yield "hammerstein-wiener", Cascade((bend, SLOW, MAPS["saturation"]), dt=DT)
    yield "static", Cascade((bend,), dt=DT)
    yield "finite", Cascade((fir([0.5, 0.2, 0.1], delay=2),), dt=DT)
    for rate in (1, 2, 3):
        for delay in (0, 2, 20):
            yield f"oversampling {rate}, delay {delay}", Cascade((FAST, bend, SLOW), 0.1, 0.2, delay, rate, dt=DT)


def feedback() -> Iterator[tuple[str, FeedbackModel]]:
    """Feedback models with every map, none, and several, with delays and oversampling."""
    for name, static in MAPS.items():
        yield f"feedback, {name}", FeedbackModel(LOOP, (static,), np.array([1.5]), 0.2, dt=DT)
    yield "feedback, two maps", FeedbackModel(TWO_LOOPS, (MAPS["saturation"], MAPS["spline"]), dt=DT)
    factors = np.array([[0.0, 0.0, 0.0, 1.0], [0.03, -0.02, 0.1, 0.2]])
    maps = MAPS["saturation"], MAPS["polynomial"]
    yield "feedback, multiplied map", FeedbackModel(TWO_LOOPS, maps, dt=DT, factors=factors)
    yield "feedback, no map", FeedbackModel(LOOP[[0, 1, 3]][:, :3], dt=DT)
    yield "feedback, no state", FeedbackModel(np.array([[1.0, 0.0], [0.3, 0.7]]), (MAPS["dead-zone"],), dt=DT)
    for rate, delay, held in ((1, 2, False), (2, 0, False), (3, 20, False), (2, 1, True)):
        loop = FeedbackModel(LOOP, (MAPS["polynomial"],), np.zeros(1), 0.2, delay, rate, held, dt=DT)
        yield f"feedback, oversampling {rate}, delay {delay}{', held' * held}", loop


def plants() -> Iterator[tuple[str, GreyBox]]:
    """Motors, an axis and plants of a user, with delays, sensors and bridges."""
    rigid = replace(Motor(), inductance=0.0).rigid()
    speed, both, current = (Signal.SPEED,), (Signal.POSITION, Signal.SPEED), (Signal.SPEED, Signal.CURRENT)
    slow = Sensor(lag=2 * DT, average=True)
    law = PowerFriction(0.01, 0.01, 2.0, 0.1, 0.2, 0.05, 0.02)
    loaded = MotorPlant(replace(rigid, rotor_friction=law, load_friction=Friction()), gravity=Gravity())
    by_sign = {"voltage_drop": 0.4, "viscous_backward": 1e-5}
    sticky = replace(rigid, rotor_friction=Friction(0.02, 0.01, 2.0))
    for name, plant, signals in (
        ("rigid motor", MotorPlant(rigid), speed),
        ("rigid motor, late, slow sensor", MotorPlant(sticky, Drive(delay=1.4 * DT), slow), both),
        ("rigid motor, late by whole samples", MotorPlant(rigid, Drive(delay=3 * DT), **by_sign), current),
        ("rigid motor, warm", MotorPlant(rigid, heating=200.0, cooling=2.0, winding_rise=0.1), current),
        ("rigid motor, coasting", MotorPlant(rigid, Drive(supply=12.0, freewheel=0.5, rise=0.1)), current),
        ("elastic motor", MotorPlant(Motor(), Drive(delay=0.4 * DT), Sensor(lag=DT)), current),
        ("linear axis", LinearAxis(drive=Drive(delay=0.3 * DT), sensor=Sensor(lag=DT)), both),
        ("joint", MotorPlant(sticky, Drive(delay=0.3 * DT), Sensor(ratio=20.0), gravity=Gravity(0.4, 0.3)), both),
        ("joint, friction by load", replace(loaded, gravity=Gravity(0.02, 0.3, 0.05, 0.1)), both),
        ("own plant", OWN, speed),
        ("own plant, linear input", replace(OWN, name="linear input", between="linear", steps=2), speed),
        ("own plant, band-limited input", replace(OWN, name="band-limited input", between="band-limited"), speed),
    ):  # fmt: skip
        yield name, GreyBox(plant, signals)


def joints() -> Iterator[tuple[str, GreyBox]]:
    """A servo, and a joint with backlash by torque and by target."""
    motor = replace(Motor(), inductance=0.0).rigid()
    servo = {"feed": Feed.POSITION, "servo": Servo(1.0, 0.01, 3.0), "steps": SERVO_STEPS}
    alone = replace(motor, rotor_friction=Friction(0.02, 0.01, 2.0))
    geared = replace(motor, load_inertia=1e-4, load_friction=Friction(0.002), load_viscous=1e-3)
    for name, plant in (
        ("servo", MotorPlant(alone, Drive(delay=0.3 * DT), gravity=Gravity(0.4, 0.3), **servo)),
        ("backlash", MotorPlant(geared, Drive(delay=1.3 * DT), gravity=Gravity(0.02, 0.3), backlash=0.02)),
        ("servo, backlash", MotorPlant(geared, gravity=Gravity(0.02, 0.3), backlash=0.02, **servo)),
    ):
        yield name, GreyBox(plant, (Signal.POSITION, Signal.SPEED))


ALL: dict[str, Model] = {
    **dict(regressions()),
    **dict(state_spaces()),
    **dict(polynomials()),
    **dict(processes()),
    **dict(transfer_functions()),
    **dict(cascades()),
    **dict(feedback()),
    **dict(plants()),
}
EXPORTED: dict[str, Model] = {
    **{name: model for name, model in ALL.items() if not isinstance(model, TransferFunction)},
    **dict(joints()),
}
"""What the tests of exports run in another language."""


def inputs(seed: int = 0, samples: int = SAMPLES) -> Array:
    """(samples,) a slow sine with noise."""
    rng = np.random.default_rng(seed)
    slow = 3.0 * np.sin(2 * np.pi * 0.8 * DT * np.arange(samples))
    return slow + 0.5 * rng.standard_normal(samples)


def measured(model: Model, seed: int = 0) -> Record:
    """A record of the model itself, with a little noise on its output."""
    u, rng = inputs(seed), np.random.default_rng(100 + seed)
    clean = model.simulate(u, dt=DT).output
    return Record(u, clean + 1e-3 * np.std(clean, axis=0) * rng.standard_normal(clean.shape), DT)
