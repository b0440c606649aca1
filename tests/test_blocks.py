"""Contract tests of every block: derivatives, scaling, inverse, text, file."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline as ScipySpline
from scipy.signal import filtfilt, lfilter, lfilter_zi

from emsid.errors import ModelError
from emsid.estimation.linear.filtering import filter_rows, filtered_both_ways
from emsid.estimation.nonlinear.problem import Infeasible
from emsid.models.blocks.block import Block, block_from_data
from emsid.models.blocks.filters import Rational, fir
from emsid.models.blocks.static_maps import (
    STATIC_MAPS,
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
    Scaling,
    StaticMap,
    TwoSlopes,
    UserMap,
)
from emsid.models.blocks.static_maps.through_points import samples_around

Array = NDArray[np.float64]

FILTERS: dict[str, Rational] = {
    "fir": fir([0.5, -0.2, 0.1], delay=2),
    "gain": fir([2.0]),
    "low-pass": Rational([0.1, 0.2, 0.1], [-1.2, 0.5]),
    "many poles": Rational([0.3], [-0.9, 0.5, -0.2], delay=1),
    "delayed": Rational([0.3, 0.1, 0.2], [-0.8], delay=3),
}
KNOTS = np.array([-2.0, -0.9, -0.1, 0.4, 1.0, 2.1])
VALUES = np.array([-3.0, -1.2, -0.3, 0.1, 1.1, 1.9])
MAPS: dict[str, StaticMap] = {
    "polynomial": Polynomial(np.array([0.2, 1.5, 0.1, 0.05]), -2.5, 2.0),
    "dead-zone": DeadZone(-0.35, 0.25, 0.7, 1.3),
    "two-slopes": TwoSlopes(0.3, 0.4, 1.5),
    "saturation": Saturation(1.7, -1.1, 0.9),
    "coulomb": CoulombLinear(0.4, 1.2),
    "smooth coulomb": CoulombLinear(0.4, 1.2, width=0.3),
    "piecewise-linear": PiecewiseLinear(KNOTS, VALUES),
    "spline": CubicSpline(KNOTS, VALUES),
    "tanh": HyperbolicTangent(-0.9, 1.2),
    "even-spline": EvenSpline(np.array([0.1, 1.0, 2.0]), np.array([0.2, 0.9, 2.2])),
    "odd-spline": OddSpline(np.array([0.5, 1.0, 2.0]), np.array([0.4, 0.9, 1.2])),
    "monotone-spline": MonotoneSpline(np.array([-1.0, 0.0, 1.5]), 0.3, np.array([0.2, -0.5, 0.1])),
    "abs": Abs(),
    "user": UserMap(
        lambda x, p: p[0] * np.tanh(p[1] * x),
        lambda x, p: p[0] * p[1] / np.cosh(p[1] * x) ** 2,
        lambda x, p: np.stack([np.tanh(p[1] * x), p[0] * x / np.cosh(p[1] * x) ** 2]),
        np.array([1.5, 0.8]),
        ("height", "rate"),
    ),
}
BLOCKS: dict[str, Block] = {**FILTERS, **MAPS}
SAVED = {name: block for name, block in BLOCKS.items() if name != "user"}


def signal(samples: int = 200) -> Array:
    return np.random.default_rng(5).uniform(-2.6, 2.6, samples)


def central(function: object, at: Array, step: float = 1e-6) -> Array:
    """Rows of derivatives of a vector-valued function by central differences."""
    assert callable(function)
    rows = []
    for k in range(len(at)):
        move = np.zeros_like(at)
        move[k] = step
        rows.append((function(at + move) - function(at - move)) / (2 * step))
    return np.array(rows)


def test_an_odd_map_is_odd_and_a_monotone_one_rises_whatever_its_parameters() -> None:
    rng, x = np.random.default_rng(8), np.linspace(-4, 4, 401)
    for _ in range(20):
        odd = OddSpline(np.cumsum(rng.uniform(0.1, 1, 4)), rng.standard_normal(4))
        np.testing.assert_allclose(odd.value(-x), -odd.value(x), atol=1e-12)
        rising = MonotoneSpline(np.cumsum(rng.uniform(0.1, 1, 4)) - 1, 0.0, 3 * rng.standard_normal(4))
        assert np.all(np.diff(rising.value(x)) > 0)
        np.testing.assert_allclose(rising.scaled(-2.0, 3.0).value(-2 * x), 3 * rising.value(x), atol=1e-9)


def test_an_even_spline_loses_the_sign_and_contains_the_magnitude() -> None:
    rng, x = np.random.default_rng(8), np.linspace(-4, 4, 401)
    for _ in range(20):
        even = EvenSpline(np.cumsum(rng.uniform(0.1, 1, 4)), rng.standard_normal(4))
        np.testing.assert_allclose(even.value(-x), even.value(x), atol=1e-12)
        np.testing.assert_allclose(even.scaled(-2.0, 3.0).value(2 * x), 3 * even.value(x), atol=1e-9)
    magnitude = EvenSpline.started(x, np.abs(x) + 1.0, 10)
    np.testing.assert_allclose(magnitude.value(x), np.abs(x) + 1.0, atol=1e-6)
    np.testing.assert_allclose(magnitude.roughness() @ magnitude.values, 0.0, atol=1e-6)
    with pytest.raises(ModelError, match="zero or above"):
        EvenSpline([-1.0, 1.0], [0.0, 1.0])


def test_maps_of_a_shape_begin_at_the_closest_curve() -> None:
    x = np.random.default_rng(9).uniform(-2, 3, 2000)
    for kind in (OddSpline, MonotoneSpline):
        for sign in (1.0, -1.0):
            z = sign * np.tanh(x)
            made = kind.started(x, z, 20)
            assert np.sqrt(np.mean((made.value(x) - z - np.mean(made.value(x) - z)) ** 2)) < 0.02


@pytest.mark.parametrize("slope", [2.0, -0.5])
def test_a_hyperbolic_tangent_begins_near_its_numbers_and_is_the_smooth_sign_of_friction(slope: float) -> None:
    x = np.random.default_rng(9).uniform(-2, 3, 2000)
    truth = HyperbolicTangent(slope, 0.8)
    begun = HyperbolicTangent.started(x, truth.value(x) + 4.0, 0)
    np.testing.assert_allclose(begun.parameters, truth.parameters, rtol=0.1)
    friction = CoulombLinear(0.8 * np.sign(slope), 0.0, width=0.8 / abs(slope))
    np.testing.assert_allclose(truth.value(x), friction.value(x), rtol=1e-12)
    np.testing.assert_allclose(truth.marks()[0], [-0.8 / abs(slope), 0.8 / abs(slope)])
    assert HyperbolicTangent.started(x, np.ones(2000), 0).limit > 0
    straight = HyperbolicTangent(0.0, 0.8)
    assert (straight.pieces().jump, len(straight.marks()[0])) == (0.0, 0)


def test_a_limit_of_a_hyperbolic_tangent_is_unseen_where_hardly_any_input_is_beyond_its_bend() -> None:
    x = np.linspace(-1.0, 3.0, 400)
    for slope, unseen in ((0.5, ["low"]), (-0.5, ["high"]), (0.3, ["low", "high"]), (2.0, [])):
        found = HyperbolicTangent(slope, 1.0).findings(x)
        assert [each.data["side"] for each in found] == unseen
        assert HyperbolicTangent(slope, 1.0).bends_over(x) is (len(unseen) < 2)


@pytest.mark.parametrize("name", BLOCKS)
def test_derivatives_agree_with_finite_differences(name: str) -> None:
    block, x = BLOCKS[name], signal()
    state = np.random.default_rng(6).standard_normal(block.states)
    y = block.output(x, state)
    assert y.shape == x.shape
    assert len(block.names) == len(block.parameters)

    by_parameters = central(lambda theta: block.with_parameters(theta).output(x, state), block.parameters)
    np.testing.assert_allclose(
        block.gradient(x, y), by_parameters.reshape(len(block.parameters), len(x)), rtol=1e-6, atol=1e-7
    )
    by_state = central(lambda s: block.output(x, s), state)
    np.testing.assert_allclose(
        block.state_gradient(len(x)), by_state.reshape(block.states, len(x)), rtol=1e-6, atol=1e-7
    )
    ways = np.random.default_rng(7).standard_normal((5, len(x)))
    by_input = [(block.output(x + 1e-6 * w, state) - block.output(x - 1e-6 * w, state)) / 2e-6 for w in ways]
    block.push(x, ways)
    np.testing.assert_allclose(ways, by_input, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("name", BLOCKS)
def test_a_block_at_rest_stays_there(name: str) -> None:
    block = BLOCKS[name]
    state, level = block.resting(0.7)
    np.testing.assert_allclose(block.output(np.full(30, 0.7), state), level, rtol=1e-12)


@pytest.mark.parametrize("name", SAVED)
def test_a_block_is_saved_and_loaded(name: str) -> None:
    block, x = SAVED[name], signal()
    back = block_from_data(block.to_data())
    state = np.zeros(block.states)
    np.testing.assert_array_equal(back.output(x, state), block.output(x, state))
    assert back.equation("u", "y") == block.equation("u", "y")
    assert "y(t) = " in block.equation("u", "y")


def test_every_kind_that_a_file_may_name_is_tested_here() -> None:
    assert {block.to_data()["kind"] for block in SAVED.values()} == {"filter", *STATIC_MAPS}


@pytest.mark.parametrize("data", [{}, {"kind": "magic"}, {"kind": "spline"}, {"kind": "dead-zone", "b_l": "x"}, []])
def test_data_that_do_not_describe_a_block_are_refused(data: object) -> None:
    with pytest.raises(ModelError, match="not a block"):
        block_from_data(data)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", MAPS)
def test_scaling(name: str) -> None:
    block, x = MAPS[name], signal()
    factors = {
        Scaling.FREE: [(2.0, 3.0), (-0.5, 3.0), (2.0, -0.1), (-2.0, -0.3)],
        Scaling.JOINT: [(2.0, 2.0), (-3.0, 3.0)],
        Scaling.NONE: [(1.0, 1.0)],
    }[block.scaling]
    for i, o in factors:
        scaled = block.scaled(i, o)
        scaled.check()
        np.testing.assert_allclose(scaled.value(x), o * block.value(x / i), rtol=1e-12, atol=1e-12)
    if block.scaling is not Scaling.FREE:
        with pytest.raises(ModelError, match="factor"):
            block.scaled(2.0, 5.0)


@pytest.mark.parametrize("name", MAPS)
def test_inverse(name: str) -> None:
    block = MAPS[name]
    if name in ("abs", "even-spline", "user"):
        with pytest.raises(ModelError, match="inverse"):
            block.inverse(0.5)
        return
    x = np.linspace(-2.4, 1.9, 57)
    inside = x[(np.abs(block.value(x)) < 0.85) & (np.abs(block.slope(x)) > 0)]
    assert len(inside) > 5
    np.testing.assert_allclose(block.inverse(block.value(inside)), inside, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(block.value(block.inverse([0.5])), 0.5, rtol=1e-9)


@pytest.mark.parametrize(
    "block",
    [
        Polynomial(np.array([0.0, 0.0, 1.0])),
        PiecewiseLinear(KNOTS, np.abs(KNOTS)),
        CubicSpline(KNOTS, np.abs(KNOTS)),
        DeadZone(-1, 1, -1, 1),
        CoulombLinear(-1.0, 1.0),
    ],
)
def test_no_inverse_without_monotony(block: StaticMap) -> None:
    with pytest.raises(ModelError, match="inverse only"):
        block.inverse([0.1, 0.2])


@pytest.mark.parametrize("name", [name for name in MAPS if name not in ("abs", "even-spline", "user")])
def test_inverse_of_any_shape_of_numbers_and_of_none(name: str) -> None:
    block = MAPS[name]
    assert block.inverse([]).shape == (0,)
    assert block.inverse(0.5).shape == ()
    table = np.array([[0.5, np.nan], [0.45, 0.7]])
    there = block.inverse(table)
    np.testing.assert_array_equal(np.isnan(there), np.isnan(table))
    np.testing.assert_allclose(block.value(there)[~np.isnan(table)], table[~np.isnan(table)], rtol=1e-9)


def test_inverse_outside_the_fitted_range() -> None:
    with pytest.raises(ModelError, match="outside the range"):
        Polynomial(np.array([0.0, 1.0])).inverse(9.0)
    with pytest.raises(ModelError, match="between its limits"):
        Saturation(1.0, -1.0, 1.0).inverse(9.0)
    with pytest.raises(ModelError, match="between its limits ±2"):
        HyperbolicTangent(1.0, 2.0).inverse([0.5, -2.0])


def test_filter_rows_is_lfilter() -> None:
    rng = np.random.default_rng(8)
    rows = rng.standard_normal((7, 300))
    for block in FILTERS.values():
        out, start = np.empty_like(rows), rng.standard_normal((7, block.states))
        end = start.copy()
        filter_rows(*block.transfer, rows, out, end)
        expected, kept = lfilter(*block.transfer, rows, zi=start) if block.states else (block.numerator[0] * rows, end)
        np.testing.assert_allclose(end, kept, rtol=1e-11, atol=1e-13)
        np.testing.assert_allclose(out, expected, rtol=1e-11, atol=1e-13)
        np.testing.assert_allclose(block.output(rows[3], start[3]), expected[3], rtol=1e-11, atol=1e-13)


def test_resting_state_is_that_of_scipy() -> None:
    block = FILTERS["low-pass"]
    np.testing.assert_allclose(block.resting(1.0)[0], lfilter_zi(*block.transfer), rtol=1e-12)


def test_filter_frequency_response_and_gain() -> None:
    block = FILTERS["low-pass"]
    assert block.gain == pytest.approx(block.response([0.0], 1e-3)[0].real)
    assert block.amplified(1 / block.gain).gain == pytest.approx(1)
    assert Rational([1.0, -1.0]).gain == pytest.approx(2)  # blocks DC; its peak counts
    tone = np.cos(2 * np.pi * 0.1 * np.arange(400))
    response = complex(block.response(0.1, 1.0))
    expected = np.real(response * np.exp(2j * np.pi * 0.1 * np.arange(400)))
    np.testing.assert_allclose(block.output(tone, np.zeros(2))[200:], expected[200:], atol=1e-12)


def test_spline_is_natural_and_continues_as_a_line() -> None:
    block = CubicSpline(KNOTS, VALUES)
    reference = ScipySpline(KNOTS, VALUES, bc_type="natural")
    x = np.linspace(KNOTS[0], KNOTS[-1], 101)
    np.testing.assert_allclose(block.value(x), reference(x), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(block.slope(x), reference(x, 1), rtol=1e-10, atol=1e-12)
    for end, beyond in ((KNOTS[0], KNOTS[0] - 3.0), (KNOTS[-1], KNOTS[-1] + 3.0)):
        line = reference(end) + reference(end, 1) * (beyond - end)
        assert block.value(np.array([beyond]))[0] == pytest.approx(line, rel=1e-12)
    rows = block.parameter_gradient(np.linspace(-4, 4, 50))
    np.testing.assert_allclose(rows.T @ VALUES, block.value(np.linspace(-4, 4, 50)), rtol=1e-12, atol=1e-12)


def test_two_knots_make_a_line() -> None:
    x = signal()
    np.testing.assert_allclose(CubicSpline(np.array([0.0, 2.0]), np.array([1.0, 2.0])).value(x), 1 + x / 2, rtol=1e-12)


@pytest.mark.parametrize("name", [name for name, block in MAPS.items() if block.marks()[1] == "knots"])
def test_a_map_with_more_knots_is_the_same_curve_with_one_more_between_each_two(name: str) -> None:
    block, finer, x = MAPS[name], MAPS[name].with_more_knots(), signal()
    np.testing.assert_allclose(finer.value(x), block.value(x), rtol=1e-9, atol=1e-9)
    assert set(block.marks()[0]) < set(finer.marks()[0])
    assert finer.size >= 2 * block.size - 1


def test_polynomial_in_powers() -> None:
    block = Polynomial.from_powers([0.1, 1.0, -0.5, 0.0], -3.0, 1.0)
    x = signal()
    np.testing.assert_allclose(block.value(x), 0.1 + x - 0.5 * x**2, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(block.powers, [0.1, 1.0, -0.5, 0.0], atol=1e-13)


def test_a_user_map_is_printed_under_its_name_if_it_has_one() -> None:
    def bend(x: Array, p: Array) -> Array:
        return np.tanh(p[0] * x)

    def slope(x: Array, p: Array) -> Array:
        return p[0] / np.cosh(p[0] * x) ** 2

    block = UserMap(bend, slope, lambda x, p: (x / np.cosh(p[0] * x) ** 2)[None], np.array([2.0]), ("rate",))
    assert block.expression("x") == "bend(x, rate=2)"
    assert UserMap(lambda x, p: x, lambda x, p: np.ones_like(x)).expression("x") == "f(x)"


def test_a_users_map_cannot_change_its_input() -> None:
    def clipped(x: Array, p: Array) -> Array:
        x[x < 0] = 0
        return x

    with pytest.raises(ModelError, match="function of a user's map failed: ValueError: assignment destination is read"):
        UserMap(clipped, lambda x, p: (x > 0).astype(float))

    def seen(x: Array, p: Array) -> Array:
        assert not any(each.flags.writeable for each in (x, p))
        return np.maximum(x, 0.0)

    x = signal()
    before = x.copy()
    UserMap(seen, lambda x, p: (x > 0).astype(float)).value(x)
    np.testing.assert_array_equal(x, before)
    assert x.flags.writeable


def test_a_sum_that_begins_with_a_minus() -> None:
    assert Rational([-0.5, 0.1]).equation("u", "y") == "y(t) = (-0.5 + 0.1*q^-1) u(t)"


def test_dead_zone_is_equation_4_9() -> None:
    zone = DeadZone(-0.5, 0.25, 2.0, 3.0)
    np.testing.assert_allclose(zone.value(np.array([-1.5, -0.5, 0.0, 0.25, 1.25])), [-2, 0, 0, 0, 3])
    assert zone.expression("x") == "3*max(x-0.25, 0) + 2*min(x+0.5, 0)"


def cubic(jacobian: Any) -> UserMap:
    """A cubic map with its derivative, and another one by its parameter."""
    return UserMap(lambda x, p: p[0] * x**3, lambda x, p: 3 * p[0] * x**2, jacobian, np.array([-10.0]))


@pytest.mark.parametrize(
    ("function", "derivative", "inputs", "at_four"),
    [
        (lambda x, p: np.abs(x), lambda x, p: np.sign(x), (-3.0, 3.0), 4.0),
        (lambda x, p: np.sign(x), lambda x, p: np.zeros_like(x), (-3.0, 3.0), 1.0),
        (lambda x, p: np.sqrt(x), lambda x, p: 0.5 / np.sqrt(x), (-3.0, 3.0), 2.0),
        (lambda x, p: np.log(x - 3), lambda x, p: 1 / (x - 3), (10.0, 20.0), 0.0),
    ],
    ids=["kink", "jump", "half an axis", "no typical input"],
)
def test_a_map_with_a_kink_or_without_values_somewhere_passes_its_check(
    function: Any, derivative: Any, inputs: tuple[float, float], at_four: float
) -> None:
    with np.errstate(all="raise"):
        assert UserMap(function, derivative, inputs=inputs).value(np.array([4.0])) == [at_four]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Rational([]), "at least one numerator"),
        (lambda: Rational([1.0, np.nan]), "finite"),
        (lambda: Rational([[1.0]]), "one dimension"),
        (lambda: Rational([1.0], delay=-1), "look ahead"),
        (lambda: Rational([1.0], delay=1.5), r"delay 1\.5.* whole number"),  # type: ignore[arg-type]
        (lambda: Polynomial(np.array([0.0, 1.0]), -np.inf, 1.0), "finite and not empty"),
        (lambda: DeadZone(np.nan, 1.0), "dead-zone with b_l = nan"),
        (lambda: Saturation(1.0, -np.inf, 1.0), "saturation with low = -inf"),
        (lambda: CoulombLinear(1.0, np.inf), "coulomb with linear = inf"),
        (lambda: Polynomial(np.array([1.0])), "at least two"),
        (lambda: CubicSpline(KNOTS[::-1], VALUES), "ascend"),
        (lambda: PiecewiseLinear(KNOTS, VALUES[:2]), "6 knots and 2 values"),
        (lambda: CoulombLinear(1.0, 1.0, width=-1.0), "width"),
        (lambda: UserMap(np.multiply, np.multiply, None, np.ones(2), ("a", "b")), "derivative with respect"),
        (lambda: UserMap(np.multiply, np.multiply, np.multiply, np.ones(2), ("a",)), "1 names for 2"),
        (lambda: UserMap(lambda x, p: x[:3], lambda x, p: x), r"function .* shape \(3,\) instead of \(101,\)"),
        (lambda: UserMap(lambda x, p: 0.0, lambda x, p: x), r"function .* shape \(\) instead"),  # type: ignore
        (lambda: UserMap(lambda x, p: x, lambda x, p: 1.0), "derivative .* shape"),  # type: ignore
        (lambda: UserMap(lambda x, p: x[999], lambda x, p: x), "function .* failed: IndexError: index"),
        (lambda: UserMap(lambda x, p: x + 0j, lambda x, p: x), "function .* returned complex128 numbers"),
        (lambda: UserMap(lambda x, p: x * np.nan, lambda x, p: x), "not finite at inputs from -3 to 3; .* inputs="),
        (lambda: UserMap(lambda x, p: x**3, lambda x, p: -3 * x**2), "derivative .* is wrong at 101 of 101 inputs"),
        (lambda: UserMap(lambda x, p: x, lambda x, p: x, inputs=(1, 0)), "the smallest and the largest typical"),
        (lambda: cubic(lambda x, p: x**3), r"jacobian .* shape \(101,\) instead of \(1, 101\)"),
        (lambda: cubic(lambda x, p: -(x**3)[None]), r"jacobian \(row 0, the derivative by p1\) .* is wrong"),
        (lambda: MAPS["user"].to_data(), "cannot be saved"),
    ],
)
def test_bad_blocks(make: object, message: str) -> None:
    assert callable(make)
    with pytest.raises(ModelError, match=message):
        make()


@pytest.mark.parametrize(
    "block", [Rational([1.0], [-1.1]), DeadZone(1.0, -1.0), Saturation(1.0, 2.0, 1.0), HyperbolicTangent(1.0, 0.0)]
)
def test_parameters_of_a_block_that_cannot_run_are_infeasible(block: Block) -> None:
    with pytest.raises(Infeasible):
        block.check()


def test_a_filter_continues_from_its_recorded_states() -> None:
    block = Rational([0.5, 0.2, 0.1], [-1.3, 0.45, -0.1], delay=1)
    x = np.random.default_rng(0).standard_normal(60)
    state, _ = block.resting(x[0])
    y = block.output(x, state)
    visited = block.visited(x, y, np.arange(60))
    np.testing.assert_allclose(block.visited(x, y, np.array([0, 7, 40])), visited[:, [0, 7, 40]], atol=1e-12)
    np.testing.assert_allclose(visited[:, 0], state, atol=1e-12)
    np.testing.assert_allclose(block.output(x[40:], visited[:, 40]), y[40:], atol=1e-12)


@pytest.mark.parametrize(
    ("above", "below"), [([0.1], [1.0, -0.9]), ([2.0, 0.6], [2.0, -3.0, 1.2]), ([0.5, 0.5], [1.0])]
)
def test_a_filter_forwards_and_backwards_is_that_of_scipy(above: list[float], below: list[float]) -> None:
    rows = np.random.default_rng(0).standard_normal((2, 80)).cumsum(axis=1)
    found = filtered_both_ways(above, below, rows, 25)
    np.testing.assert_allclose(found, filtfilt(above, below, rows, padlen=25), rtol=1e-10, atol=1e-10)
    np.testing.assert_array_equal(filtered_both_ways(above, below, rows[1], 25), found[1])


def test_knots_at_bends_are_where_a_curve_bends() -> None:
    even = np.linspace(-3.0, 3.0, 31)
    clipped = CubicSpline(even, np.clip(even, -1.0, 1.0))
    moved = clipped.at_bends(np.linspace(-3.0, 3.0, 1000))
    assert len(moved.knots) == 31
    np.testing.assert_allclose(moved.knots[[0, -1]], [-3.0, 3.0])
    close = [int(np.sum(np.abs(np.abs(each) - 1.0) < 0.35)) for each in (even, moved.knots)]
    assert close[1] > 1.5 * close[0]
    at = np.linspace(-3.0, 3.0, 200)
    np.testing.assert_allclose(moved.value(at), clipped.value(at), atol=0.05)
    rare = clipped.at_bends(np.linspace(-3.0, 0.5, 1000))
    assert samples_around(rare.knots[:-1], np.linspace(-3.0, 0.5, 1000)).min() >= 5
    assert len(rare.knots) < 31
