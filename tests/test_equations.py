"""A parser simulates the text of `equation` and gets the same output as the model."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline as Spline
from scipy.interpolate import make_interp_spline
from scipy.signal import lfilter, resample

from emsid import LinearAxis, MotorPlant
from emsid.models.blocks.cascade import Cascade
from emsid.models.feedback.model import FeedbackModel
from emsid.models.linear.polynomials import PolynomialModel
from emsid.models.linear.process_model import ProcessModel
from emsid.models.linear.state_space import StateSpaceModel
from emsid.models.linear.transfer_function import TransferFunction
from emsid.models.model import Model
from emsid.models.plants.driven import NEED_SUPPLY
from emsid.models.plants.gravity import Gravity
from emsid.models.plants.grey_box import GreyBox
from emsid.models.regression.narx import Narx
from emsid.plant import Friction, Motor, PowerFriction
from model_examples import ALL, DT, OWN

Array = NDArray[np.float64]
BEFORE, SAMPLES, MARGIN = 400, 300, 40
FUNCTIONS: dict[str, Any] = {
    "tanh": np.tanh, "sign": np.sign, "abs": np.abs, "exp": np.exp, "max": np.maximum, "min": np.minimum,
}  # fmt: skip


def smooth_input() -> Array:
    """Nothing at first, then tones far below half the sampling rate: any band-limited interpolation agrees on them."""
    t = np.arange(SAMPLES + MARGIN) * DT
    rise = (1 - np.exp(-((t / 0.2) ** 2))) ** 2
    return rise * (2.0 * np.sin(2 * np.pi * 0.9 * t) + np.sin(2 * np.pi * 3.1 * t))


def value_of(text: str, names: dict[str, Any]) -> Any:
    return eval(text.replace("^", "**"), {"__builtins__": {}}, FUNCTIONS | names)


def by_regression(text: str, u: Array, rest: float) -> Array:
    """y(t) = … in past outputs and inputs, sample by sample, from an output at rest."""
    right = text.removeprefix("y(t) = ").removesuffix(" + e(t)")
    u, y = np.concatenate([np.zeros(BEFORE), u]), np.full(BEFORE + len(u), rest)
    for t in range(BEFORE, len(y)):
        y[t] = value_of(right, {"t": t, "u": u.__getitem__, "y": y.__getitem__})
    return y[BEFORE:]


def polynomial(text: str, rate: int) -> Array:
    """Coefficients of 1 - 0.7*q^-(1/2) by powers of q^-(1/rate)."""
    coefficients: dict[int, float] = {}
    for sign, number, power in re.findall(r"([+-]?) ?(\d[\d.]*(?:e[+-]?\d+)?)(?:\*q\^-\(?([\d/]+)\)?)?(?= |$)", text):
        steps = Fraction(power or 0) * rate
        assert steps.denominator == 1
        coefficients[int(steps)] = float(number) * (-1 if sign == "-" else 1)
    return np.array([coefficients.get(k, 0.0) for k in range(max(coefficients) + 1)])


def points(word: str) -> Callable[..., Array]:
    """What a map through points is between them, and straight on beyond."""

    def through(x: Array, *pairs: tuple[float, float]) -> Array:
        knots, values = np.array(pairs).T
        spline = Spline(knots, values, bc_type="natural")
        inside = np.clip(x, knots[0], knots[-1])
        if word == "spline":
            return np.asarray(spline(inside) + spline(inside, 1) * (x - inside))
        slopes = np.diff(values) / np.diff(knots)
        beyond = np.where(x < knots[0], slopes[0], slopes[-1])
        return np.asarray(np.interp(inside, knots, values) + beyond * (x - inside))

    return through


def odd_spline(x: Array, *pairs: tuple[float, float]) -> Array:
    """The natural spline through points, their mirror images and the origin."""
    mirrored = [(-knot, -value) for knot, value in reversed(pairs)]
    return points("spline")(x, *mirrored, (0.0, 0.0), *pairs)


def even_spline(x: Array, *pairs: tuple[float, float]) -> Array:
    """The natural spline through points, of the magnitude."""
    return points("spline")(np.abs(x), *pairs)


def monotone_spline(x: Array, first: float, *pairs: tuple[float, float]) -> Array:
    """The integral of straight lines through (knot, slope), ``first`` at the first knot."""
    knots, slopes = np.array(pairs).T
    line = make_interp_spline(knots, slopes, k=1)
    area, inside = line.antiderivative(), np.clip(x, knots[0], knots[-1])
    return np.asarray(first + area(inside) - area(knots[0]) + line(inside) * (x - inside))


MAPS = {
    "linear": points("linear"),
    "spline": points("spline"),
    "even_spline": even_spline,
    "odd_spline": odd_spline,
    "monotone_spline": monotone_spline,
    "f": lambda x, p1: p1 * np.cbrt(x),
}


def by_blocks(text: str, u: Array) -> Array:
    """Line by line, every signal over all times."""
    sums = r"([^()]*(?:\([\d/]+\)[^()]*)*)"  # with powers in brackets
    faster = re.search(r", with u interpolated .* t = 0, 1/(\d+), … samples(?: of [\d.e-]+ s)?$", text, re.MULTILINE)
    rate = int(faster[1]) if faster else 1
    text = text.replace(faster[0], "") if faster else text
    padded = np.concatenate([np.zeros(BEFORE), u, u[-1:] * np.linspace(1, 0, 100)])
    signals = {"u": resample(padded, rate * len(padded))}
    for line in text.removesuffix(" + e(t)").split("\n"):
        name, right = re.fullmatch(r"(\w+)\(t\) = (.*)", line).groups()  # type: ignore[union-attr]
        filtered = re.fullmatch(rf"\({sums}\)(?:/\({sums}\))? (\w+)\(t\)(?: ([+-] [\d.e-]+))?", right)
        if filtered:
            above, below, source, offset = filtered.groups()
            b, a = polynomial(above, rate), polynomial(below or "1", rate)
            signals[name] = lfilter(b, a, signals[source]) + float((offset or "0").replace(" ", ""))
            continue

        def at(source: str) -> Callable[[Any], Array]:
            return lambda late: np.concatenate([np.zeros(late * rate), signals[source]])[: len(signals[source])]

        right = re.sub(r"\(t(?:-(\d+))?\)", lambda late: f"({late[1] or 0})", right).replace(";", ",")
        calls = {source: at(source) for source in signals}
        signals[name] = value_of(right, calls | MAPS) + np.zeros(len(signals["u"]))
    return signals["y"][::rate][BEFORE : BEFORE + len(u)]


def by_steps(text: str, u: Array) -> Array:
    """Line by line in one step, and step after step."""
    faster = re.search(
        r", with u (held|interpolated) .*t = 0, 1/(\d+), … samples(?: of [\d.e-]+ s)?$", text, re.MULTILINE
    )
    rate = int(faster[2]) if faster else 1
    text = text.replace(faster[0], "") if faster else text
    late = re.match(r"v\(t\) = u\(t(?:-(\d+))?\)\n", text)
    delay = rate * int(late[1] or 0) if late else 0
    padded = np.concatenate([np.zeros(BEFORE), u, u[-1:] * np.linspace(1, 0, 100)])
    between = np.repeat(padded, rate) if faster and faster[1] == "held" else resample(padded, rate * len(padded))
    fine = np.concatenate([np.zeros(delay), between])
    text = text.replace(" + e(t)", "").replace(";", ",")
    text = re.sub(r"(\b[a-z]\d?)\(t\)", r"\1", text[late.end() :] if late else text)
    lines = [line.split(" = ") for line in text.split("\n")]
    now: dict[str, Any] = {name.split("(")[0]: 0.0 for name, _ in lines}
    outputs = []
    for level in fine[: rate * (BEFORE + len(u))]:
        now |= {"v": level, "u": level}
        after = {}
        for name, right in lines:
            value = value_of(right, MAPS | now)
            (after if "(" in name else now)[name.split("(")[0]] = value
        outputs.append(now["y"])
        now |= after
    return np.array(outputs)[::rate][BEFORE:]


PLAIN = replace(
    Motor(),
    rotor_friction=Friction(),
    load_friction=Friction(),
    voltage_dead_zone=None,
    rotor_viscous=0.0,
    load_viscous=0.0,
    shaft_damping=0.0,
)
OWN_PLANTS = {
    "plant": OWN,
    "linear input": replace(OWN, name="linear input", between="linear", steps=2),
    "band-limited input": replace(OWN, name="band-limited input", between="band-limited"),
}
PLANTS: dict[str, Any] = {
    "rigid-motor": MotorPlant(replace(PLAIN, inductance=0.0, load_inertia=1e-30).rigid()),
    "motor": MotorPlant(PLAIN),
    "joint": MotorPlant(replace(PLAIN, inductance=0.0, load_inertia=1e-30).rigid(), gravity=Gravity()),
    "linear-axis": LinearAxis(friction=Friction()),
    **{name: own.with_values({"gain": 0.0, "damping": 0.0}) for name, own in OWN_PLANTS.items()},
}


def by_states(text: str, u: Array) -> Array:
    """The states one step later, and the outputs now, without noise."""
    lines = [re.sub(r"\((?:t)\)", "", line).split(" = ") for line in text.split("\n")]
    state = {name.removesuffix("(t+1)"): 0.0 for name, _ in lines if name.endswith("(t+1)")}
    silent = {f"e{k}": 0.0 for k in ("", 1, 2)}
    outputs = []
    for value in u:
        now = {**state, **silent, "u": value}
        outputs.append([value_of(right, now) for name, right in lines if not name.endswith("(t+1)")])
        state = {name.removesuffix("(t+1)"): value_of(right, now) for name, right in lines if name.endswith("(t+1)")}
    return np.array(outputs)


def by_polynomials(text: str, u: Array) -> Array:
    """(A) y(t) = (B)/(F) u(t) + constant, without noise, from rest without input."""
    sums = r"\(((?:[^()])*)\)"
    left, right = text.split(" y(t) = ") if " y(t) = " in text else ("(1)", text.removeprefix("y(t) = "))
    parts = re.match(rf"{sums}(?:/{sums})? u\(t\)(?: \+ ([\d.e-]+)(?= |$))?", right)
    assert parts is not None
    above, below = polynomial(parts[1], 1), polynomial(parts[2] or "1", 1)
    of_y = polynomial(left.strip("()"), 1)
    constant = float(parts[3] or 0) / of_y.sum()
    padded = np.concatenate([np.zeros(BEFORE), u])
    return np.asarray(lfilter(above, np.convolve(below, of_y), padded) + constant)[BEFORE:]


def by_parameters(text: str, model: GreyBox, u: Array) -> Array:
    """A plant without anything, and the parameters that are printed."""
    name, _, rest = text.partition(": ")
    found = {key: float(number) for key, number in re.findall(r"([\w.]+) = ([\d.e+-]+)", rest)}
    late = {key: found.pop(key) for key in NEED_SUPPLY if key in found}
    plant = PLANTS[name]
    if "rotor_friction.motor" in found:  # the law is in the file, not in the equation
        plant = plant.with_frictions({"rotor_friction": PowerFriction(), "load_friction": Friction()})
    plant = plant.with_values(found).with_values(late)
    return GreyBox(plant, model.signals).simulate(u, dt=DT).output


def by_process(text: str, u: Array) -> Array:
    """Gain, zero, time constants, dead time and offset as they are printed."""
    gain = float(re.findall(r"y = ([-\d.e]+)", text)[0])
    above, below = text.split("/", 1)
    zero = [float(number) for number in re.findall(r"\(1 \+ ([-\d.e]+)\*s\)", above)]
    constants = [float(number) for number in re.findall(r"\(1 \+ ([-\d.e]+)\*s\)", below)]
    delay = [float(number) for number in re.findall(r"exp\(-([\d.e]+)\*s\)", below)]
    offset = [float(number) for number in re.findall(r"u \+([-\d.e]+)", below)]
    first = {"zero": sum(zero), "delay": sum(delay), "offset": sum(offset)}
    return ProcessModel(gain, tuple(constants), dt=DT, **first).simulate(u).output


def by_transfer_function(text: str, u: Array) -> Array:
    """Coefficients of powers of s or z, dead time and offset as they are printed."""
    discrete = "z" in text

    def polynomial(part: str) -> Array:
        found: dict[int, float] = {}
        for term in part.split():
            number, *power = re.split(r"\*?[sz]\^?", term)
            found[int(power[0] or 1) if power else 0] = float(number) if number else 1.0
        return np.array([found.get(k, 0.0) for k in range(max(found), -1, -1)])

    above, below = (
        polynomial(part) for part in re.findall(r"\(([^()]*)\)(?=/|\*|\s|$)", text.replace("exp(", "exp["))[:2]
    )
    delay = sum(float(number) for number in re.findall(r"exp\(-([\d.e-]+)\*s\)", text))
    delay += sum(DT * int(number) for number in re.findall(r"\*z\^-(\d+) u", text))
    level = sum(float(number) for number in re.findall(r" u ([+-][\d.e-]+)", text))
    return TransferFunction(above, below, delay, level, DT, discrete).simulate(u).output


@pytest.mark.parametrize("name", ALL)
def test_the_printed_equation_simulates_as_the_model_does(name: str) -> None:
    model: Model = ALL[name]
    if isinstance(model, GreyBox) and model.plant.name not in OWN_PLANTS and model.plant.sensor.average:
        model = replace(model, plant=replace(model.plant, sensor=replace(model.plant.sensor, average=False)))
    u = smooth_input()
    start = model.at_rest(0.0, DT)
    expected = model.run(start, np.concatenate([u, np.zeros(model.latency)])[:, None])[0][model.latency :]
    text = model.equation()
    if isinstance(model, Narx):
        found = by_regression(text, u, float(start[-1, 0]) if model.memory else 0.0)[:, None]
    elif isinstance(model, Cascade):
        found = by_blocks(text, u)[:, None]
    elif isinstance(model, FeedbackModel):
        found = by_steps(text, u)[:, None]
    elif isinstance(model, StateSpaceModel):
        found = by_states(text, u)
    elif isinstance(model, PolynomialModel):
        found = by_polynomials(text, u)[:, None]
    elif isinstance(model, ProcessModel):
        found = by_process(text, u)
    elif isinstance(model, TransferFunction):
        found = by_transfer_function(text, u)
    else:
        assert isinstance(model, GreyBox)
        found = by_parameters(text, model, u)
    error = np.sqrt(np.mean((found - expected)[:SAMPLES] ** 2, axis=0))
    assert (error < 1e-4 * np.std(expected[:SAMPLES], axis=0)).all()


def test_steps_of_blocks_are_printed_as_fractions_of_a_sample() -> None:
    text = ALL["oversampling 2, delay 2"].equation()
    assert text.splitlines()[0] == (
        "v(t) = u(t-2) - 0.1, with u interpolated (band-limited) at t = 0, 1/2, … samples of 0.01 s"
    )
    assert "(0.2*q^-1 + 0.1*q^-(3/2))/(1 - 1.1*q^-(1/2) + 0.4*q^-1)" in text
