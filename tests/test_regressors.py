"""Structures: the regression they build, their text and its way back, and the equations of the paper."""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from emsid import ModelError, Record, Structure, arx, friction_narx, wiener_hammerstein_regression
from emsid.models.regression.kernels import fill
from emsid.models.regression.regressors import HIGHEST_POWER, Factor, Regressor, parse_regressor
from emsid.models.regression.transforms import Transform
from independent.regressions import regression_of

Array = NDArray[np.float64]


# --- any structure ---------------------------------------------------------------------------------------------------


@st.composite
def factors(draw: st.DrawFn, inputs: int = 3) -> Factor:
    channel = draw(st.integers(0, inputs))
    transform = draw(st.sampled_from(Transform))
    parameter = 0.0
    if transform in (Transform.TANH, Transform.DECAY):
        parameter = draw(st.floats(1e-3, 1e3))
    elif transform in (Transform.ABOVE, Transform.BELOW):
        parameter = draw(st.floats(-2, 2, allow_subnormal=False))
    return Factor(channel, draw(st.integers(int(channel == 0), 5)), draw(st.integers(1, 3)), transform, parameter)


def bases(factor: Factor) -> tuple[int, int, Transform, float]:
    return factor.channel, factor.lag, factor.transform, factor.parameter


products = st.builds(
    Regressor, st.lists(factors(), max_size=3, unique_by=bases).map(tuple), st.booleans()
)  # equal factors are one factor with a power
structures = st.lists(products, min_size=1, max_size=6, unique=True).map(lambda r: Structure(tuple(r), inputs=3))


@settings(max_examples=60, derandomize=True, deadline=None)
@given(structures, st.integers(0, 2**32 - 1))
def test_the_kernel_equals_the_definition(structure: Structure, seed: int) -> None:
    rng = np.random.default_rng(seed)
    u, y = rng.uniform(-2, 2, (30, 3)), rng.uniform(-2, 2, 30)
    phi, target = structure.regression(Record(u, y, 0.1))
    np.testing.assert_allclose(phi, regression_of(structure, y, u), rtol=1e-12, atol=1e-300)
    np.testing.assert_array_equal(target, y[structure.memory :])


@settings(max_examples=300, derandomize=True, deadline=None)
@given(products)
def test_text_is_read_back_as_the_same_regressor(regressor: Regressor) -> None:
    assert parse_regressor(str(regressor)) == regressor


@settings(max_examples=100, derandomize=True, deadline=None)
@given(st.floats(1e-300, 1e300), st.sampled_from([Transform.TANH, Transform.DECAY, Transform.ABOVE, Transform.BELOW]))
def test_parameters_are_read_back_to_the_last_bit(parameter: float, transform: Transform) -> None:
    for value in (parameter,) if transform in (Transform.TANH, Transform.DECAY) else (parameter, -parameter):
        regressor = Regressor((Factor(1, 2, 1, transform, value),))
        assert parse_regressor(str(regressor)).factors[0].parameter == value


@pytest.mark.parametrize("block", [1, 7, 10_000])
def test_blocks_cut_the_regression_anywhere(monkeypatch: pytest.MonkeyPatch, block: int) -> None:
    monkeypatch.setattr("emsid.models.regression.narx.BLOCK", block)
    rng = np.random.default_rng(0)
    structure = friction_narx(2, 2, knots=(0.3,))
    record = Record(rng.uniform(-1, 1, 50), rng.uniform(-1, 1, 50), 0.1, breaks=(20, 21))
    phi, y = structure.regression(record)
    pieces = [(record.input[a:b], record.output[a:b, 0]) for a, b in ((0, 20), (21, 50))]  # one sample is too short
    np.testing.assert_allclose(phi, np.vstack([regression_of(structure, y, u) for u, y in pieces]), rtol=1e-14)
    np.testing.assert_array_equal(y, np.concatenate([y[2:] for _, y in pieces]))
    rows = [stop - start for segment, start, stop in structure.chunks(record, 11)]
    assert (sum(rows), max(rows)) == (len(y), 11)


def test_fill_does_not_change_the_signals_and_starts_at_its_start() -> None:
    structure = Structure.parse("y(t-1)", "-u(t)^2")
    y, u = np.arange(10.0), -np.arange(10.0)[:, None]
    block = np.empty((3, 4))
    fill(block, structure.tables, y, np.ascontiguousarray(u.T), 5, 4)
    np.testing.assert_array_equal(block, [[4, 5, 6, 7], [-25, -36, -49, -64], [5, 6, 7, 8]])
    np.testing.assert_array_equal(y, np.arange(10.0))


# --- the equations of the paper --------------------------------------------------------------------------------------


def test_linear_model_of_the_paper() -> None:
    structure = arx(na=4, nb=4)
    assert structure.labels == (
        *("-y(t-1)", "-y(t-2)", "-y(t-3)", "-y(t-4)"),
        *("u(t-1)", "u(t-2)", "u(t-3)", "u(t-4)"),
    )  # (5.12)
    assert structure.parameter_names == ("a1", "a2", "a3", "a4", "b1", "b2", "b3", "b4")  # (5.13)
    assert structure.equation() == (
        "y(t) = - a1*y(t-1) - a2*y(t-2) - a3*y(t-3) - a4*y(t-4) + b1*u(t-1) + b2*u(t-2) + b3*u(t-3) + b4*u(t-4) + e(t)"
    )
    assert (structure.memory, structure.inputs, structure.name) == (4, 1, "arx")


def test_nonlinear_model_of_the_paper() -> None:
    structure = wiener_hammerstein_regression(na=4, nb=3, degree=2)
    assert structure.labels == (
        *("-y(t-1)", "-y(t-2)", "-y(t-3)", "-y(t-4)"),
        *("u(t-1)", "u(t-2)", "u(t-3)", "u(t-1)^2", "u(t-2)^2", "u(t-3)^2"),
    )  # (5.10)
    assert structure.parameter_names == ("a1", "a2", "a3", "a4", "s1", "s2", "s3", "s4", "s5", "s6")  # (5.11)
    assert wiener_hammerstein_regression(4, 3, 2, cross_terms=False).regressors == structure.regressors


@pytest.mark.parametrize(("nb", "degree", "taps", "nk"), [(1, 2, 2, 1), (2, 3, 2, 0), (3, 2, 3, 2), (2, 4, 1, 1)])
def test_regressors_are_the_monomials_of_the_expanded_cascade(nb: int, degree: int, taps: int, nk: int) -> None:
    """(3.5): term l of the second filter sees products of inputs with lags from l to l + taps − 1 only."""
    structure = wiener_hammerstein_regression(1, nb, degree, taps, nk)
    found = {
        tuple(sorted(lag for f in regressor.factors for lag in [f.lag] * f.power))
        for regressor in structure.regressors[1:]
    }
    lags = range(nk, nk + nb + taps - 1)
    expected = {
        monomial
        for power in range(1, degree + 1)
        for monomial in combinations_with_replacement(lags, power)
        if monomial[-1] - monomial[0] < taps
    }
    assert found == expected
    assert len(structure) == 1 + len(expected)


def test_regression_of_the_cascade_spans_its_output() -> None:
    """The output of an FIR filter, a polynomial and a second FIR filter is a combination of the regressors."""
    u = np.random.default_rng(1).uniform(-1, 1, 400)
    x = np.convolve(u, [1.0, -0.5, 0.25])[:400]
    y = np.convolve(2 * x + 0.7 * x**2 - 0.3 * x**3, [0.0, 1.0, 0.4])[:400]
    structure = wiener_hammerstein_regression(0, 2, 3, taps=3)
    phi, target = structure.regression(Record(u, y, 0.1))
    theta, *_ = np.linalg.lstsq(phi, target, rcond=None)
    np.testing.assert_allclose(phi @ theta, target, atol=1e-11)
    fewer, target = wiener_hammerstein_regression(0, 2, 3, taps=3, cross_terms=False).regression(Record(u, y, 0.1))
    assert np.linalg.norm(fewer @ np.linalg.lstsq(fewer, target, rcond=None)[0] - target) > 1.0


def test_friction_regressors() -> None:
    structure = friction_narx(na=1, nb=2, knots=(-0.5, 0.25), speeds=(0.1,), nk=0)
    assert structure.labels == (
        *("-y(t-1)", "u(t)", "u(t-1)"),
        *("min(u(t)+0.5, 0)", "min(u(t-1)+0.5, 0)", "max(u(t)-0.25, 0)", "max(u(t-1)-0.25, 0)"),
        *("-sign(y(t-1))", "-sign(y(t-1))*exp(-abs(y(t-1))/0.1)", "1"),
    )
    assert structure.parameter_names == ("a1", "b1", "b2", "h1_1", "h1_2", "h2_1", "h2_2", "c0", "c1", "offset")
    smooth = friction_narx(1, 1, sign=Transform.TANH, width=2.0)
    assert smooth.labels == ("-y(t-1)", "u(t-1)", "-tanh(y(t-1)/2)", "1")


def test_arx_of_several_inputs_and_delays() -> None:
    structure = arx(1, 2, nk=3, inputs=2)
    assert structure.labels == ("-y(t-1)", "u(t-3)", "u(t-4)", "u2(t-3)", "u2(t-4)")
    assert structure.parameter_names == ("a1", "b1_1", "b1_2", "b2_1", "b2_2")
    assert (structure.memory, structure.inputs) == (4, 2)


@pytest.mark.parametrize("na", [0, 1, 5])
@pytest.mark.parametrize("nb", [1, 3])
def test_every_regressor_has_a_name_of_its_own(na: int, nb: int) -> None:
    for structure in (
        arx(na, nb, inputs=3),
        wiener_hammerstein_regression(na, nb, 3, taps=2),
        friction_narx(max(na, 1), nb, knots=(-1.0, 1.0), speeds=(0.5,)),
    ):
        assert len(set(structure.parameter_names)) == len(structure) == len(structure.labels)


# --- equations and values --------------------------------------------------------------------------------------------


def test_equation_with_numbers_carries_their_signs_and_those_of_the_regressors() -> None:
    structure = Structure.parse("-y(t-1)", "u(t-1)", "1", "-sign(u(t))")
    assert structure.equation([-0.5, -2.0, 3.0, 0.25]) == "y(t) = 0.5*y(t-1) - 2*u(t-1) + 3 - 0.25*sign(u(t)) + e(t)"
    assert structure.equation([0.5, 2.0, -3.0, 0.0]) == "y(t) = - 0.5*y(t-1) + 2*u(t-1) - 3 + e(t)"
    assert structure.equation([0.0, 2.0, 0.0, 0.0]) == "y(t) = 2*u(t-1) + e(t)"
    assert structure.equation([0.0, -0.0, 0.0, 0.0]) == "y(t) = 0 + e(t)"


def test_sign_convention_is_that_of_a_transfer_function() -> None:
    """(1 + a q⁻¹) y = b q⁻¹ u: the impulse response is b(−a)ᵏ."""
    y = 2.0 * (-0.5) ** np.arange(-1, 9.0)
    y[0] = 0.0
    u = np.zeros(10)
    u[0] = 1.0
    phi, target = arx(1, 1).regression(Record(u, y, 1.0))
    np.testing.assert_allclose(phi @ [0.5, 2.0], target, rtol=1e-15)


def test_sum_of_structures_keeps_every_regressor_once() -> None:
    both = arx(2, 1) + Structure.parse("u(t-1)", "abs(u2(t-1))", "-y(t-1)", "y(t-1)")
    assert both.labels == ("-y(t-1)", "-y(t-2)", "u(t-1)", "abs(u2(t-1))", "y(t-1)")
    assert (both.inputs, both.name, both.memory) == (2, "arx", 2)
    assert len(both.parameter_names) == 5


def test_structures_are_values() -> None:
    assert arx(2, 2) == arx(2, 2)
    assert hash(arx(2, 2)) == hash(arx(2, 2))
    assert arx(2, 2) != arx(2, 2, nk=2)


# --- text ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "canonical"),
    [
        ("y(t-1)*u(t-2)^2", "y(t-1)*u(t-2)^2"),
        ("u(t)", "u(t)"),
        ("u1(t-3)", "u(t-3)"),
        ("  u2( t - 1 ) ** 3 ", "u2(t-1)^3"),
        ("u(t-1)*u(t-1)*u(t-1)^2", "u(t-1)^4"),
        ("(y(t-1)*u(t-1))^2", "y(t-1)^2*u(t-1)^2"),
        ("-y(t-1)*u(t-1)", "-y(t-1)*u(t-1)"),
        ("y(t-1)*(-u(t-1))", "-y(t-1)*u(t-1)"),
        ("--y(t-1)", "y(t-1)"),
        ("-y(t-1)^2", "-y(t-1)^2"),
        ("(-y(t-1))^2", "y(t-1)^2"),
        ("(-y(t-1))^3", "-y(t-1)^3"),
        ("-(y(t-1)*(-u(t)))", "y(t-1)*u(t)"),
        ("sign(y(t-1))*exp(-abs(y(t-1))/0.25)", "sign(y(t-1))*exp(-abs(y(t-1))/0.25)"),
        ("tanh(y(t-1)/2.0)^2", "tanh(y(t-1)/2)^2"),
        ("max(u(t-1)-0.30, 0)", "max(u(t-1)-0.3, 0)"),
        ("max(u(t-1)+0.3, 0.0)", "max(u(t-1)+0.3, 0)"),
        ("min(u(t-1), 0)", "min(u(t-1), 0)"),
        ("1", "1"),
        ("-1", "-1"),
        ("1*u(t-1)", "u(t-1)"),
    ],
)
def test_texts_that_can_be_parsed(text: str, canonical: str) -> None:
    assert str(parse_regressor(text)) == canonical


BAD_TEXTS = {
    "nothing": ("", "not understood"),
    "blank": ("   ", "not understood"),
    "half": ("y(t-1", "not understood"),
    "a present output": ("y(t)", "cannot look ahead"),
    "a future input": ("u(t+1)", "'u\\(t \\+ 1\\)' is not a lagged channel"),
    "a future input, disguised": ("u(t--1)", "is not a lagged channel"),
    "half a sample": ("u(t-0.5)", "is not a lagged channel"),
    "another channel": ("w(t-1)", "no channel 'w'"),
    "input zero": ("u0(t-1)", "no channel 'u0'"),
    "another time": ("u(k-1)", "is not a lagged channel"),
    "a bare name": ("u", "is not a lagged channel"),
    "a sum": ("u(t-1)+u(t-2)", "is not a lagged channel"),
    "a quotient": ("u(t-1)/u(t-2)", "is not a lagged channel"),
    "a coefficient": ("2*u(t-1)", "'2' is not a lagged channel"),
    "a root": ("u(t-1)^0.5", "is not a lagged channel"),
    "an inverse": ("u(t-1)^-1", "is not a lagged channel"),
    "power zero": ("u(t-1)^0", "is not a lagged channel"),
    "a huge power": ("u(t-1)^1000000000000", "powers are whole numbers from 1 to 99"),
    "a tower of powers": ("((u(t-1)^9)^9)^9", "powers are whole numbers from 1 to 99"),
    "an unknown function": ("sin(u(t-1))", "is not a lagged channel"),
    "sign of a sum": ("sign(u(t-1)+1)", "is not a lagged channel"),
    "nested": ("abs(sign(u(t-1)))", "is not a lagged channel"),
    "tanh without scale": ("tanh(u(t-1))", "is not a lagged channel"),
    "tanh over zero": ("tanh(u(t-1)/0)", "scale must be positive"),
    "decay over minus one": ("exp(-abs(u(t-1))/-1)", "is not a lagged channel"),
    "growth": ("exp(abs(u(t-1))/0.1)", "is not a lagged channel"),
    "an infinite knot": ("max(u(t-1)-1e999, 0)", "finite"),
    "a hinge at one": ("max(u(t-1), 1)", "is not a lagged channel"),
    "extra arguments": ("u(t-1, 2)", "is not a lagged channel"),
    "named arguments": ("u(t-1, x=2)", "is not a lagged channel"),
    "an assignment": ("u = 1", "not understood"),
    "a statement": ("import os", "not understood"),
    "code": ("__import__('os').system('true')", "is not a lagged channel"),
    "code as an argument": ("sign(open('x'))", "is not a lagged channel"),
    "code as a lag": ("u(t-exit())", "is not a lagged channel"),
    "a lambda": ("(lambda: u(t-1))()", "is not a lagged channel"),
    "a walrus": ("(u := 3)", "is not a lagged channel"),
    "an attribute": ("u.real(t-1)", "is not a lagged channel"),
    "a format string": ("f'{u}'", "is not a lagged channel"),
    "a null byte": ("u(t-1)\0", "not understood"),
    "endless brackets": ("(" * 500 + "u(t-1)" + ")" * 500, "not understood"),
    "endless minus signs": ("-" * 100_000 + "u(t-1)", "not understood"),
    "endless factors": ("*".join(["u(t-1)"] * 20_000), "not understood|powers"),
}


@pytest.mark.parametrize("case", list(BAD_TEXTS))
def test_texts_that_cannot_be_parsed_are_refused_with_the_reason(case: str) -> None:
    text, message = BAD_TEXTS[case]
    with pytest.raises(ModelError, match=message) as refusal:
        Structure.parse("u(t-1)", text)
    assert "\n" not in str(refusal.value)
    assert len(str(refusal.value)) < 300


@settings(max_examples=300, derandomize=True, deadline=None)
@given(st.text(st.sampled_from("yu(t-)12*^+0.,/ absigntanhexpm\"'[]=:"), max_size=30))
def test_any_text_is_a_regressor_or_refused(text: str) -> None:
    try:
        regressor = parse_regressor(text)
    except ModelError:
        return
    assert parse_regressor(str(regressor)) == regressor


# --- refusals --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Structure(()), "at least one regressor"),
        (lambda: arx(0, 0), "at least one regressor"),
        (lambda: Structure.parse("u(t-1)", "y(t-1)", "u(t-1)"), r"u\(t-1\) stands twice"),
        (lambda: Structure((Regressor(),), parameter_names=("a", "b")), "2 parameter names for 1 regressor"),
        (lambda: arx(-1, 2), "na is too small"),
        (lambda: arx(1, 1, inputs=0), "inputs is too small"),
        (lambda: wiener_hammerstein_regression(1, 0, 2), "nb is too small"),
        (lambda: wiener_hammerstein_regression(1, 1, 0), "degree is too small"),
        (lambda: wiener_hammerstein_regression(1, 1, 1, taps=0), "taps is too small"),
        (lambda: friction_narx(0, 1), "na is too small"),
        (lambda: friction_narx(1, 1, knots=(0.5, 0.5)), "stands twice"),
        (lambda: friction_narx(1, 1, knots=(np.nan,)), "finite"),
        (lambda: friction_narx(1, 1, speeds=(0.0,)), "scale must be positive"),
        (lambda: friction_narx(1, 1, sign=Transform.TANH), "scale must be positive"),
        (lambda: friction_narx(1, 1, sign=Transform.ABS), "no sign of the speed"),
        (lambda: Factor(0, 0), "cannot look ahead"),
        (lambda: Factor(1, -1), "cannot look ahead"),
        (lambda: Factor(1, 1, 0), "powers are whole numbers"),
        (lambda: Factor(1, 1, HIGHEST_POWER + 1), "powers are whole numbers"),
        (lambda: Factor(1, 1, 1, Transform.SIGN, 0.5), "has no parameter"),
        (lambda: Factor(1, 1, 1, Transform.DECAY, np.inf), "finite"),
    ],
)
def test_invalid_structures_are_refused(make: object, message: str) -> None:
    with pytest.raises(ModelError, match=message):
        make()  # type: ignore[operator]


@pytest.mark.parametrize(
    ("record", "message"),
    [
        (Record(np.zeros((9, 1)), np.zeros((9, 2)), 1.0), "has one output and record 2; choose one of y1, y2"),
        (Record(np.zeros((9, 1)), np.zeros((9, 1)), 1.0), "uses input u2; record has 1"),
        (Record(np.zeros((9, 2)), np.zeros(9), 1.0, breaks=(3, 6)), "longest segment has 3 samples; structure looks"),
    ],
)
def test_records_it_cannot_be_built_from_are_refused(record: Record, message: str) -> None:
    structure = Structure.parse("y(t-3)", "u2(t)")
    for use in (structure.check, structure.regression):
        with pytest.raises(ModelError, match=message):
            use(record)


def test_too_many_regressors_are_refused_before_they_are_created() -> None:
    for size in ({"degree": 5, "taps": 20}, {"degree": 99, "taps": 2}, {"degree": 99, "taps": 1000}):
        with pytest.raises(ModelError, match=r"make .* regressors, and 1,000 are the most; lower some of them"):
            wiener_hammerstein_regression(4, 3, **size)
    with pytest.raises(ModelError, match="degree 100; powers go up to 99, lower it"):
        wiener_hammerstein_regression(1, 1, 100)
    with pytest.raises(ModelError, match="na = 4, nb = 1000, inputs = 1000 make 1,000,004 regressors"):
        arx(4, 1000, inputs=1000)
    with pytest.raises(ModelError, match="nb = 500, knots = 1000, speeds = 0 make 500,506 regressors"):
        friction_narx(4, 500, knots=range(1000))
    with pytest.raises(ModelError, match="make 1,001 regressors"):
        arx(1, 1000)
    assert len(wiener_hammerstein_regression(0, 1, 3, taps=333, cross_terms=False).regressors) == 999
