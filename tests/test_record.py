"""Records: invalid arguments, slicing, filtering and concatenation."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from emsid.errors import DataError
from emsid.record import Record, check_same_channels, concatenate, hold_back, segments, time_axis
from emsid.record.holding_back import _pieces, excerpt, outside_excerpt


def ramp(samples: int = 10, dt: float = 0.1, **fields: object) -> Record:
    k = np.arange(float(samples))
    return Record(k, np.column_stack([2 * k, -k]), dt, **fields)  # type: ignore[arg-type]


def test_one_dimensional_arrays_are_one_channel() -> None:
    record = Record(np.zeros(5), np.ones(5), 0.5)
    assert record.input.shape == record.output.shape == (5, 1)
    assert (record.input_names, record.output_names, record.input_units) == (("u1",), ("y1",), ("",))
    np.testing.assert_array_equal(record.time, [0, 0.5, 1, 1.5, 2])
    assert repr(record) == "Record(record: 5 samples, dt 0.5 s; u1, y1)"


def test_samples_cannot_be_written_to() -> None:
    with pytest.raises(ValueError, match="read-only"):
        ramp().input[0] = 1.0


def test_samples_do_not_change_with_the_arrays_they_came_from() -> None:
    u, y = np.arange(10.0), np.arange(20.0).reshape(10, 2)
    frozen = y.view()
    frozen.flags.writeable = False
    records = [Record(u, y, 0.1), Record(u[::-1], frozen, 0.1), Record(u[None].T, y[:, :1], 0.1)]
    before = [(record.input.copy(), record.output.copy()) for record in records]
    u[:], y[:] = 7.0, 7.0
    for record, (old_input, old_output) in zip(records, before, strict=True):
        np.testing.assert_array_equal(record.input, old_input)
        np.testing.assert_array_equal(record.output, old_output)


def test_parts_of_a_record_are_no_copies() -> None:
    record = ramp(100, breaks=(30,))
    for part in (record[5:], *record.split(0.5), *record.segments, *record[2:].segments[1].split(0.5)):
        assert np.shares_memory(part.input, record.input)
        assert np.shares_memory(part.output, record.output)
    assert Record(record.input, record.output, 0.1).input is record.input


def test_an_excerpt_has_pieces_from_all_of_a_record_and_its_extremes() -> None:
    k = np.arange(10_000.0)
    u, y = np.sin(k), np.cos(k)
    u[4321], y[7654] = 5.0, -3.0  # between the pieces at equal distances
    record = Record(u, y, 0.1)
    few = excerpt(record, 800)
    assert len(few) == 800
    assert len(few.segments) == 8
    assert (few.input.max(), few.output.min()) == (5.0, -3.0)
    starts = np.array(few.times) / 0.1
    assert np.all(np.diff(starts) >= 100)
    assert starts[0] == 0
    assert starts[-1] == 9_900
    for first, piece in zip(np.rint(starts).astype(int), few.segments, strict=True):
        np.testing.assert_array_equal(piece.output, record.output[first : first + 100])
    assert excerpt(record, 10_000) is record
    assert outside_excerpt(record, 10_000) is None
    rest = outside_excerpt(record, 800)
    both = np.concatenate([few.input[:, 0], rest.input[:, 0]])
    np.testing.assert_array_equal(np.sort(both), np.sort(u))


def test_an_excerpt_of_many_experiments_has_a_piece_of_each() -> None:
    series = concatenate([Record(np.full(2_000, float(n)), np.zeros(2_000), 0.1) for n in range(20)])
    assert set(excerpt(series, 10_000).input[:, 0]) == set(map(float, range(20)))


@pytest.mark.parametrize("sizes", [(3_000, 2_500, 4_500), (60,) * 150, (5_000, *(50,) * 100), (4_990, 10, 5_000)])
def test_no_piece_of_an_excerpt_contains_a_gap(sizes: tuple[int, ...]) -> None:
    rng = np.random.default_rng(0)
    series = concatenate([Record(rng.normal(size=(n, 1)), rng.normal(size=(n, 1)), 0.1) for n in sizes])
    edges = np.array([0, *series.breaks, len(series)])
    for place in (10, 2_990, 3_003, 4_985, 4_993, 5_005, len(series) - 3):
        u = series.input.copy()
        u[place] = 50.0
        record = replace(series, input=u)
        pieces = _pieces(record, 800, 8)
        assert all(stop - first > 0 for first, stop in pieces)
        assert all(stop <= first for (_, stop), (first, _) in pairwise(pieces))
        for first, stop in pieces:
            assert stop <= edges[np.searchsorted(edges, first, side="right")]
        few = excerpt(record, 800)
        assert 400 <= len(few) <= 800
        assert few.input.max() == 50.0
        assert len(few.segments) == len(pieces)


def test_an_input_without_output_is_a_record() -> None:
    record = Record(np.arange(100.0), np.empty((100, 0)), 0.1)
    assert record.output.shape == (100, 0)
    assert record.decimate(2).output.shape == (50, 0)
    assert record.detrend().output.shape == (100, 0)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"output": np.zeros(4)}, "input has 5 samples and output 4"),
        ({"input": np.empty(0), "output": np.empty(0)}, "no samples"),
        ({"input": np.zeros((5, 1, 1))}, r"shape \(5, 1, 1\)"),
        ({"input": np.zeros((2, 5))}, "more channels than samples"),
        ({"input": np.zeros(5, complex)}, "log: input holds complex numbers; give real numbers"),
        ({"output": ["a", 1, 2, 3, 4]}, "log: output holds text"),
        ({"output": [None, "a", 2, 3, 4]}, "log: output holds something else than numbers"),
        ({"output": [[1, 2], [3], [4], [5], [6]]}, "something else than numbers"),
        ({"output": np.array([1, 2, 3, 4, 5], "datetime64[s]")}, "something else than numbers"),
        ({"dt": "fast"}, "sample time 'fast' s; give a positive number"),
        ({"dt": 0.0}, "sample time 0.0 s; give a positive number"),
        ({"dt": np.nan}, "sample time nan s"),
        ({"input": np.array([1, 2, np.nan, 4, 5])}, "channel 'u1' is nan at sample 2"),
        ({"input": np.array([1, np.inf, -np.inf, 4, 5])}, "channel 'u1' is inf at sample 1"),
        ({"input_names": ("a", "b")}, "2 input names for 1 input channels"),
        ({"output_units": ("V", "A")}, "2 output units for 1 output channels"),
        ({"input_names": ("x",), "output_names": ("x",)}, "two channels are called 'x'"),
        ({"breaks": (0,)}, "must ascend inside 1 … 4"),
        ({"breaks": (3, 2)}, "must ascend"),
        ({"breaks": (5,)}, "must ascend"),
        ({"breaks": (2,), "times": (0.0,)}, "1 segment times for 2 segments"),
    ],
)
def test_invalid_arguments_are_refused(fields: dict[str, object], message: str) -> None:
    whole: dict[str, object] = {"input": np.zeros(5), "output": np.zeros(5), "dt": 0.1, "name": "log", **fields}
    with pytest.raises(DataError, match=message):
        Record(**whole)  # type: ignore[arg-type]


def test_large_values_are_finite_even_if_their_sum_is_not() -> None:
    assert len(Record(np.full(5, 1e308), np.full(5, -1e308), 1.0)) == 5


def test_slicing_keeps_time_and_breaks() -> None:
    record = ramp(10, breaks=(4, 8), times=(0.0, 10.0, 20.0))
    part = record[2:9]
    assert (part.breaks, part.times) == ((2, 6), (0.2, 10.0, 20.0))
    np.testing.assert_allclose(part.time, record.time[2:9])
    assert record[-3:].times == (pytest.approx(10.3), 20.0)
    assert record[4:].breaks == (4,)


@pytest.mark.parametrize(
    ("rows", "message"), [(slice(0, 4, 2), "without a step"), (slice(7, 7), "select none of its 10")]
)
def test_slices_with_a_step_or_without_samples_are_refused(rows: slice, message: str) -> None:
    with pytest.raises(DataError, match=message):
        ramp()[rows]


def test_every_fourth_of_many_experiments_is_selection_data() -> None:
    steps = concatenate([ramp(10 + k) for k in range(1, 10)])
    rest, held = hold_back(steps, 0.25)
    assert [len(one) for one in held.segments] == [14, 18]
    assert [len(one) for one in rest.segments] == [11, 12, 13, 15, 16, 17, 19]
    np.testing.assert_array_equal(held.segments[1].output, ramp(18).output)


@pytest.mark.parametrize("lengths", [[40], [10, 10, 10, 10], [50] + [3] * 7, [3, 3, 3, 40, 3, 3, 3, 3]])
def test_the_end_of_few_or_unequal_segments_is_selection_data(lengths: list[int]) -> None:
    record = concatenate([ramp(length) for length in lengths])
    for part, expected in zip(hold_back(record, 0.25), record.split(0.75), strict=True):
        np.testing.assert_array_equal(part.output, expected.output)
        assert part.breaks == expected.breaks


def test_split_parts_add_up_to_the_record() -> None:
    first, second = ramp(10).split(0.7)
    assert (len(first), len(second)) == (7, 3)
    np.testing.assert_array_equal(np.concatenate([first.input, second.input]), ramp(10).input)
    assert second.times == (pytest.approx(0.7),)
    with pytest.raises(DataError, match="cannot split at 1"):
        ramp().split(1)
    with pytest.raises(DataError, match="2 samples cannot be split"):
        ramp(2).split(0.9)


@given(arrays(bool, st.integers(1, 30)), st.sets(st.integers(1, 29)))
def test_a_mask_keeps_the_other_samples_at_their_times(out: np.ndarray, breaks: set[int]) -> None:
    inside = tuple(sorted(b for b in breaks if b < len(out)))
    record = ramp(len(out), breaks=inside) if len(out) > 1 else Record([0.0], [0.0], 0.1)
    if out.all():
        with pytest.raises(DataError, match="leaves no sample"):
            record.mask(out)
        return
    masked = record.mask(out)
    np.testing.assert_array_equal(masked.input, record.input[~out])
    np.testing.assert_allclose(masked.time, record.time[~out], atol=1e-12)
    # a segment of what is left is a run of neighbours that no break of the record divides
    kept = np.flatnonzero(~out)
    begins = [k for k in range(1, len(kept)) if kept[k] != kept[k - 1] + 1 or kept[k] in inside]
    assert list(masked.breaks) == begins


def test_a_mask_has_one_value_per_sample() -> None:
    with pytest.raises(DataError, match=r"a mask of shape \(3,\) for 10 samples"):
        ramp().mask([True, False, False])


def test_segments_are_records_of_their_own() -> None:
    record = ramp(10, breaks=(4,), times=(0.0, 5.0))
    assert [len(piece) for piece in segments([record, ramp(3)])] == [4, 6, 3]
    assert record.segments[1].times == (5.0,)
    assert len(ramp().segments) == 1


def test_channels_by_name() -> None:
    np.testing.assert_array_equal(ramp(3).channel("y2"), [0, -1, -2])
    with pytest.raises(DataError, match="no channel 'speed'; there are u1, y1, y2"):
        ramp().channel("speed")


def test_a_unit_in_the_name_of_a_channel_may_be_left_out() -> None:
    names = ("speed (rpm)", "speed [rad/s]")
    record = ramp(3, input_names=("u [V]",), output_names=names, input_units=("V",), output_units=("", "rad/s"))
    np.testing.assert_array_equal(record.channel("u"), [0, 1, 2])
    np.testing.assert_array_equal(record.channel("speed [rpm]"), [0, 2, 4])
    scaled = record.scale("u", 2.0).convert({"u": "mV"})
    assert (scaled.input_names, scaled.input_units, scaled.input[1, 0]) == (("u [V]",), ("mV",), 2000.0)
    with pytest.raises(DataError, match=r"several channels are called 'speed': speed \(rpm\), speed \[rad/s\]"):
        record.channel("speed")
    with pytest.raises(DataError, match=r"no channel 'u \[A\]'"):
        record.channel("u [A]")


def test_detrending_subtracts_one_polynomial_from_all_segments() -> None:
    t = np.arange(50) * 0.1
    record = Record(3 + 2 * t, 1 - t + 0.5 * t**2, 0.1, breaks=(20,))
    assert np.abs(record.detrend(1).input).max() < 1e-12
    assert np.abs(record.detrend(2).output).max() < 1e-12
    assert abs(record.detrend().output.mean()) < 1e-12
    assert len(Record([1.0], [2.0], 0.1).detrend()) == 1
    with pytest.raises(DataError, match=r"detrending of order 1\.5; give 0"):
        ramp().detrend(1.5)  # type: ignore[arg-type]
    with pytest.raises(DataError, match="order -1"):
        record.detrend(-1)
    with pytest.raises(DataError, match=r"order 99; give .* at most 5, because a higher"):
        record.detrend(99)


def test_decimation_keeps_the_slow_and_removes_the_fast() -> None:
    t = np.arange(4000) * 1e-3
    slow, fast = np.sin(2 * np.pi * 2 * t), np.sin(2 * np.pi * 180 * t)
    record = Record(slow + 5, slow + fast, 1e-3, name="drive").decimate(10)
    assert (record.dt, len(record)) == (pytest.approx(0.01), 400)
    inside = slice(30, -30)
    np.testing.assert_allclose(record.output[inside, 0], slow[::10][inside], atol=2e-3)
    np.testing.assert_allclose(record.input[inside, 0], 5 + slow[::10][inside], atol=2e-3)
    with pytest.raises(DataError, match="segment of 30 samples is too short to decimate by 10"):
        ramp(30).decimate(10)
    with pytest.raises(DataError, match=r"cannot decimate by 2\.5; give a whole number"):
        ramp(100).decimate(2.5)  # type: ignore[arg-type]
    with pytest.raises(DataError, match="cannot decimate by 0"):
        ramp().decimate(0)
    assert ramp().decimate(1).dt == 0.1


def test_scale_and_convert() -> None:
    record = Record(np.ones(4), np.ones(4), 0.01, ("pwm",), ("speed",), ("pwm",), ("count/sample",))
    si = record.convert(counts_per_revolution=100, supply_voltage=12.0)
    np.testing.assert_allclose(si.channel("speed"), 2 * np.pi)
    np.testing.assert_allclose(si.channel("pwm"), 12 / 255)
    assert (si.input_units, si.output_units) == (("V",), ("rad/s",))
    np.testing.assert_allclose(si.convert({"speed": "rpm"}).channel("speed"), 60)
    np.testing.assert_allclose(record.scale("speed", 2.0, 1.0, "V").channel("speed"), 3)
    assert record.scale("speed", 2.0).output_units == ("count/sample",)
    with pytest.raises(DataError, match="no channel 'torque'"):
        record.convert({"torque": "N*m"})


def test_concatenation_makes_segments() -> None:
    whole = concatenate([ramp(4), ramp(6, breaks=(3,)), ramp(2)], name="all")
    assert (whole.name, whole.breaks) == ("all", (4, 7, 10))
    assert [len(piece) for piece in whole.segments] == [4, 3, 3, 2]
    with pytest.raises(DataError, match="no record"):
        concatenate([])


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (ramp(4, dt=0.2, name="b"), "b is sampled every 0.2 s and record every 0.1 s"),
        (ramp(4, input_names=("v",), name="b"), "b has input names"),
        (ramp(4, output_units=("A", "B"), name="b"), "b has output units"),
    ],
)
def test_records_with_different_channels_cannot_be_joined(other: Record, message: str) -> None:
    with pytest.raises(DataError, match=message):
        check_same_channels(ramp(), other)


def test_records_whose_names_write_the_same_unit_in_other_ways_can_be_joined() -> None:
    def record(name: str, unit: str) -> Record:
        return ramp(4, input_names=(name,), input_units=(unit,))

    whole = concatenate([record("u [V]", "V"), record("u (V)", "V"), record("u", "V"), record("u [mV]", "V")])
    assert (whole.input_names, whole.input_units, len(whole)) == (("u [V]",), ("V",), 16)
    with pytest.raises(DataError, match=r"input names \('u \[mV\]',\) and record \('u \[V\]',\); they must agree"):
        concatenate([record("u [V]", "V"), record("u [mV]", "")])
    with pytest.raises(DataError, match="input names"):  # both scaled, so that no unit is known
        concatenate([record("u [V]", ""), record("u [mV]", "")])


@given(
    st.integers(2, 2000),
    st.sampled_from([0.001, 0.02, 0.010048, 1 / 51200, 1 / 3, 2.5e-6, 1.0]),
    st.sampled_from([0.0, 0.37, 1e3]),
)
def test_the_intended_sample_time_is_recovered(samples: int, dt: float, start: float) -> None:
    axis = time_axis(start + dt * np.arange(samples))
    assert axis.regular
    assert axis.dt == pytest.approx(dt, rel=1e-13 * max(1, start / (dt * samples)))
    if start == 0:
        assert axis.dt == dt  # bit by bit


def test_few_digits_in_a_time_column_do_not_bias_the_sample_time() -> None:
    times = np.round(np.arange(3000) / 3000, 5)
    assert time_axis(times).dt == pytest.approx(1 / 3000, rel=1e-5)
    assert time_axis(np.round(0.02 * np.arange(500), 3)).dt == 0.02


def test_jitter_does_not_move_the_sample_time() -> None:
    rng = np.random.default_rng(1)
    axis = time_axis(0.01 * np.arange(1000) + rng.uniform(-1e-4, 1e-4, 1000))
    assert axis.regular
    assert axis.dt == 0.01
    assert 0.01 < axis.jitter < 0.02


def test_gaps_and_duplicates_are_found_and_reported() -> None:
    t = np.array([0, 1, 2, 3, 7, 8, 8, 9, 10.0])
    axis = time_axis(t)
    assert (axis.dt, axis.gaps, axis.lengths, axis.duplicates, axis.regular) == (1.0, (4,), (4.0,), (6,), False)
    report = "9 samples, dt 1 s, jitter 0 %, 1 gap (at sample 4, 4 s), 1 duplicate (at sample 6)"
    assert str(axis) == report
    many = time_axis(np.delete(np.arange(5000.0) * 1e-3, [10, 20, 21, 30]))
    assert str(many).endswith("jitter 0 %, 3 gaps (first at sample 10, longest 3 ms at sample 19), no duplicates")


def test_a_regular_axis_is_reported_too() -> None:
    t = 0.005 * np.arange(12000)
    assert str(time_axis(t)) == "12,000 samples, dt 5 ms, jitter 0 %, no gaps, no duplicates"
    assert str(time_axis(1e4 + t)) == str(time_axis(t))  # the rounding of the times is no jitter
    t[7000] += 3e-6
    report = "12,000 samples, dt 5 ms, jitter 0.06 % (largest deviation of a step 3 µs), no gaps, no duplicates"
    assert str(time_axis(t)) == report
    assert time_axis(t).jitter == pytest.approx(6e-4)


def test_a_record_keeps_its_time_axis() -> None:
    axis = time_axis(0.1 * np.arange(100))
    record = ramp(100, time_axis=axis)
    assert record[3:].time_axis is record.detrend().time_axis is axis
    assert concatenate(record.split(0.5)).time_axis == axis
    assert concatenate([record, ramp(100)]).time_axis is None
    assert record.decimate(2).time_axis is None
    assert record.resample(record.time, dt=0.2).time_axis is None


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([1.0], "has 1 sample, and a sample time needs two; take more rows"),
        ([1, np.nan, 3], "no finite value at sample 1"),
        ([3, 2, 1], "never advances, it is 3 s at first and 1 s at last; name"),
    ],
)
def test_invalid_times_are_refused(times: list[float], message: str) -> None:
    with pytest.raises(DataError, match=message):
        time_axis(times)


def test_resampling_holds_inputs_and_interpolates_outputs() -> None:
    t = np.array([0.0, 0.9, 2.1, 3.0, 4.0])
    record = Record([1, 2, 3, 4, 5], 10 * t, 1.0).resample(t, dt=1.0)
    np.testing.assert_array_equal(record.input[:, 0], [1, 2, 3, 4, 5])  # each step in the nearest row
    np.testing.assert_allclose(record.output[:, 0], [0, 10, 20, 30, 40])
    assert record.dt == 1.0


def test_resampling_times_of_many_digits_neither_delays_nor_loses_samples() -> None:
    k = np.delete(np.arange(3000.0), [700, 701])
    record = Record(k, k, 0.01).resample(1.7e9 + 0.01 * k)
    assert record.dt == 0.01
    np.testing.assert_array_equal(record.input[:, 0], np.where(np.isin(np.arange(3000), [700, 701]), 699, range(3000)))
    np.testing.assert_allclose(record.output[:, 0], range(3000), atol=1e-4)


def test_a_time_whose_rounding_exceeds_the_sample_time_is_one_sample() -> None:
    assert len(Record([1.0], [2.0], 0.1).resample([2e24], 0.1)) == 1


@pytest.mark.parametrize("start", [-7.3, 0.0, 1e4])
def test_resampling_a_regular_axis_changes_nothing(start: float) -> None:
    t = start + 0.1 * np.arange(200)
    record = Record(np.arange(200.0), np.arange(200.0), 0.1).resample(t, dt=0.1)
    assert len(record) == 200
    np.testing.assert_array_equal(record.input[:, 0], np.arange(200.0))
    np.testing.assert_allclose(record.output[:, 0], np.arange(200.0), atol=1e-6)
    assert record.times == (start,)


def test_the_last_sample_of_equal_times_is_used() -> None:
    record = Record([1, 2, 3, 4], [0, 0, 5, 0], 1.0).resample([0, 1, 1, 2], dt=1.0)
    np.testing.assert_array_equal(record.input[:, 0], [1, 3, 4])


@pytest.mark.parametrize(
    ("times", "dt", "message"),
    [
        ([0, 1], None, "a time for each of its samples"),
        ([0, 2, 1], None, "goes back"),
        ([0, 1, 2], 1e-12, "cannot resample 2 s to a sample time of 1e-12 s"),
        ([0, 1, 2], -1.0, "cannot resample"),
        ([0, 1, 2], np.nan, "cannot resample"),
    ],
)
def test_invalid_resampling_is_refused(times: list[float], dt: float | None, message: str) -> None:
    with pytest.raises(DataError, match=message):
        Record([1, 2, 3], [1, 2, 3], 1.0).resample(times, dt=dt)
