"""Lines of a source: headers, units, checksums, faults; and the time axis that they are put on."""

from __future__ import annotations

from functools import reduce
from operator import xor

import numpy as np
import pytest

from emsid import DataError
from emsid.live.protocol import LineParser, Rows, joined, read_header
from emsid.live.timeline import Stretch, Timeline, sample_time

LINES = b"t,u,y\n" + b"".join(b"%.3f,%d,%.2f\n" % (0.001 * k, k % 7, 0.5 * k) for k in range(50))


def parsed(data: bytes, size: int = 10_000, **options: object) -> tuple[LineParser, Rows | None]:
    parser = LineParser(**options)  # type: ignore[arg-type]
    parts = [parser.feed(data[k : k + size]) for k in range(0, len(data), size)]
    some = [part for part in (*parts, parser.flush()) if part is not None]
    return parser, joined(some) if some else None


@pytest.mark.parametrize("size", [1, 3, 17, 10_000])
def test_lines_in_pieces_of_any_size_give_the_same_rows(size: int) -> None:
    parser, rows = parsed(LINES, size)
    assert rows is not None
    np.testing.assert_allclose(rows.time, 0.001 * np.arange(50), atol=1e-12)
    np.testing.assert_array_equal(rows.input[:, 0], np.arange(50) % 7)
    np.testing.assert_array_equal(rows.output, 0.5 * np.arange(50))
    assert np.isnan(rows.number).all()
    assert (parser.malformed, parser.not_finite, rows.broken.any()) == (0, 0, False)


@pytest.mark.parametrize(
    ("text", "names", "u", "y"),
    [
        (b"t,u,y\n0,1,2\n", ("t", "u", "y"), 1.0, 2.0),
        (b"# a comment\nn,t,u,y\n0,0,1,2\n", ("n", "t", "u", "y"), 1.0, 2.0),
        (b"t;u;y\r\n0;1;2\r\n", ("t", "u", "y"), 1.0, 2.0),
        (b"t\tu\ty\n0\t1\t2\n", ("t", "u", "y"), 1.0, 2.0),
        (b"t u y\n0 1 2\n", ("t", "u", "y"), 1.0, 2.0),
        (b"0,1,2\n", ("t", "u", "y"), 1.0, 2.0),
        (b"7,0,1,2\n", ("n", "t", "u", "y"), 1.0, 2.0),
        (b"t[ms],u[mV],y[rpm]\n0,1000,60\n", ("t", "u", "y"), 1.0, 2 * np.pi),
        (b"t,u,y\n[ms],[mV],[rpm]\n0,1000,60\n", ("t", "u", "y"), 1.0, 2 * np.pi),
        (b"t,x,voltage,speed\n0,9,1,2\n", ("t", "x", "voltage", "speed"), 9.0, 1.0),
    ],
)
def test_headers_separators_and_units(text: bytes, names: tuple[str, ...], u: float, y: float) -> None:
    parser, rows = parsed(text)
    assert parser.columns is not None
    assert parser.columns.names == names
    assert rows is not None
    assert (rows.input[0, 0], rows.output[0]) == pytest.approx((u, y))


def test_columns_are_chosen_by_name() -> None:
    _, rows = parsed(b"t,a,b,c\n0,1,2,3\n", inputs=("c", "a"), output="b")
    assert rows is not None
    np.testing.assert_array_equal(rows.input, [[3.0, 1.0]])
    assert rows.output[0] == 2.0
    parser, rows = parsed(b"t,a,b,c\n0,1,2,3\n", output="d")
    assert rows is None
    assert "no column 'd'" in str(parser.problem)


def test_the_column_of_the_time_is_chosen_by_name() -> None:
    parser, rows = parsed(b"Zeit[ms],u,y\n20,2,3\n", time="Zeit")
    assert rows is not None
    assert (rows.time[0], rows.input[0, 0], rows.output[0]) == pytest.approx((0.02, 2.0, 3.0))
    parser, rows = parsed(b"t,u,y\n0,2,3\n", time="Zeit")
    assert rows is None
    assert parser.problem is not None
    assert parser.problem.arguments == ("time",)


@pytest.mark.parametrize("text", ["t,u,u", "t,y", "t,u!,y"])
def test_headers_that_cannot_be_used_are_refused(text: str) -> None:
    with pytest.raises(DataError, match="header"):
        read_header(text)


def test_checksums_are_verified_and_required_where_the_header_has_one() -> None:
    def signed(line: bytes) -> bytes:
        return b"%s*%02X\n" % (line, reduce(xor, line))

    good = signed(b"t,u,y") + signed(b"0,1,2") + signed(b"1,1,2")
    parser, rows = parsed(good)
    assert rows is not None
    assert (len(rows), parser.malformed) == (2, 0)
    parser, rows = parsed(good + b"2,1,2\n" + signed(b"3,1,2").replace(b"3,1", b"3,9"))
    assert rows is not None
    assert (len(rows), parser.malformed) == (2, 2)
    parser, rows = parsed(b"t,u,y\n" + signed(b"0,1,2") + b"1,1,2\n")  # optional where the header has none
    assert rows is not None
    assert (len(rows), parser.malformed) == (2, 0)


@pytest.mark.parametrize("bad", [b"1,2", b"1,2,3,4", b"1,x,3", b"1,,3", b"1_0,2,3", b"\xff\x80\x00,1,2", b"1,2,3*7F"])
def test_malformed_lines_are_counted_and_break_the_samples(bad: bytes) -> None:
    parser, rows = parsed(b"t,u,y\n0,1,2\n" + bad + b"\n2,1,2\n3,1,2\n")
    assert rows is not None
    assert (len(rows), parser.malformed) == (3, 1)
    assert rows.broken.tolist() == [False, True, False]


@pytest.mark.parametrize("bad", [b"nan", b"inf", b"-INF", b"ovf", b"1e300"])
def test_values_that_are_not_finite_are_counted_apart(bad: bytes) -> None:
    parser, rows = parsed(b"t,u,y\n0,1,2\n1,1," + bad + b"\n2,1,2\n")
    assert rows is not None
    assert (len(rows), parser.malformed, parser.not_finite) == (2, 0, 1)
    assert rows.broken.tolist() == [False, True]


def test_a_line_without_end_is_dropped() -> None:
    parser, rows = parsed(b"t,u,y\n" + b"1" * 10_000, size=1000)
    assert rows is None
    assert parser.malformed >= 1


def rows_of(time: list[float], number: list[float] | None = None, broken: list[bool] | None = None) -> Rows:
    n = len(time)
    counts = np.full(n, np.nan) if number is None else np.array(number, dtype=float)
    values = np.arange(n, dtype=float)
    return Rows(np.array(time), counts, values[:, None], values, np.array(broken or [False] * n))


TICKS = [0.01 * k for k in range(60)]


@pytest.mark.parametrize("size", [1, 7, 60])
def test_a_time_gap_ends_a_stretch(size: int) -> None:
    time = [t if k < 40 else t + 0.05 for k, t in enumerate(TICKS)]
    timeline, stretches = Timeline(), []
    rows = rows_of(time)
    for k in range(0, 60, size):
        stretches += timeline.place(rows[k : k + size])
    gaps = [stretch.gap for stretch in stretches if stretch.gap is not None]
    assert [(gap.samples, gap.cause) for gap in gaps] == [(5, "lost")]
    assert gaps[0].time == pytest.approx(0.45)
    assert sum(map(len, stretches)) == 60
    assert (timeline.dt, timeline.lost) == (pytest.approx(0.01), 5)


def test_sequence_numbers_find_what_a_clock_does_not() -> None:
    number = [k if k < 40 else k + 3 for k in range(60)]
    timeline = Timeline()
    (gap,) = (each.gap for each in timeline.place(rows_of(TICKS, number)) if each.gap)
    assert (gap.samples, gap.cause, timeline.lost) == (3, "lost", 3)


def test_time_that_steps_back_is_a_gap_of_unknown_length() -> None:
    time = TICKS[:40] + TICKS[:20]
    (gap,) = (each.gap for each in Timeline().place(rows_of(time)) if each.gap)
    assert (gap.samples, gap.cause, gap.time) == (None, "backwards", 0.0)


def placed(timeline: Timeline, rows: Rows, size: int) -> list[Stretch]:
    return [each for k in range(0, len(rows), size) for each in timeline.place(rows[k : k + size])]


@pytest.mark.parametrize("size", [1, 7, 60])
@pytest.mark.parametrize("unit", [1e-6, 1e-3], ids=["micros", "millis"])
def test_a_clock_of_32_bits_that_begins_again_is_no_gap(unit: float, size: int) -> None:
    ticks = 2**32 - round(0.3 / unit) + np.arange(60) * round(0.01 / unit)
    timeline = Timeline()
    stretches = placed(timeline, rows_of(((ticks % 2**32) * unit).tolist()), size)
    assert [stretch.gap for stretch in stretches if stretch.gap] == []
    assert (sum(map(len, stretches)), timeline.lost) == (60, 0)
    assert timeline.dt == pytest.approx(0.01)
    assert timeline.time == pytest.approx(ticks[-1] * unit)


def test_samples_that_are_lost_where_a_clock_begins_again_are_counted() -> None:
    ticks = 2**32 - 300_000 + np.delete(np.arange(60), [29, 30, 31]) * 10_000
    timeline = Timeline()
    (gap,) = (each.gap for each in timeline.place(rows_of(((ticks % 2**32) * 1e-6).tolist())) if each.gap)
    assert (gap.samples, gap.cause, timeline.lost) == (3, "lost", 3)


@pytest.mark.parametrize("bits", [8, 16, 32])
@pytest.mark.parametrize("clocked", [True, False])
def test_a_counter_that_begins_again_is_no_gap(bits: int, clocked: bool) -> None:
    number = (2**bits - 30 + np.delete(np.arange(60), 40)) % 2**bits
    time = np.delete(TICKS, 40) if clocked else np.full(59, np.nan)
    timeline = Timeline(0.01)
    gaps = [each.gap for each in placed(timeline, rows_of(time.tolist(), number.tolist()), 8) if each.gap]
    assert [(gap.samples, gap.cause) for gap in gaps] == [(1, "lost")]


def test_a_board_that_begins_again_is_no_turn_of_its_clock() -> None:
    time = [*(4000.0 + np.array(TICKS)), *TICKS]
    (gap,) = (each.gap for each in Timeline().place(rows_of(time, [*range(60), *range(60)])) if each.gap)
    assert (gap.samples, gap.cause, gap.time) == (None, "backwards", 0.0)
    turned = [*((4294.8 + np.array(TICKS)) % (2**32 * 1e-6)), 9.9, *TICKS]
    gaps = [each.gap for each in Timeline().place(rows_of(turned)) if each.gap]
    assert [(gap.cause, gap.time) for gap in gaps] == [("lost", pytest.approx(4304.867296)), ("backwards", 0.0)]


def test_unusable_lines_are_a_gap_and_repeated_ones_are_left_out() -> None:
    time = [*TICKS[:40], *TICKS[41:]]
    (gap,) = (each.gap for each in Timeline().place(rows_of(time, broken=[k == 40 for k in range(59)])) if each.gap)
    assert (gap.samples, gap.cause) == (1, "unusable")
    timeline = Timeline()
    stretches = timeline.place(rows_of([*TICKS[:40], TICKS[39], *TICKS[40:]]))
    assert (len(stretches), len(stretches[0]), timeline.repeated) == (1, 60, 1)


def test_without_a_clock_the_sample_time_is_needed() -> None:
    rows = rows_of([np.nan] * 30)
    with pytest.raises(DataError, match="no time column"):
        Timeline().place(rows)
    (stretch,) = Timeline(0.01).place(rows)
    assert (len(stretch), stretch.time) == (30, 0.0)


def test_jitter_of_the_clock_is_no_gap() -> None:
    rng = np.random.default_rng(0)
    time = [t + 0.002 * rng.uniform(-1, 1) for t in TICKS]
    timeline = Timeline()
    assert [each.gap for each in timeline.place(rows_of(time))] == [None]
    assert timeline.dt == pytest.approx(0.01, rel=0.05)


def test_a_clock_that_stands_is_refused() -> None:
    with pytest.raises(DataError, match="does not increase"):
        sample_time(np.zeros(20))


def test_a_header_that_was_cut_off_is_waited_for_again() -> None:
    parser, rows = parsed(b"n,t[us],u,\n0,0,1,2\nn,t[us],u,y\n1,1000,1,2\n")
    assert rows is not None
    assert (rows.time.tolist(), parser.malformed) == ([0.001], 2)


def test_a_connection_that_is_joined_midway_gets_its_header_first() -> None:
    parser = LineParser()
    parser.implies = False
    assert parser.feed(b"5,5000,1,2\n6,6000,1,2\n") is None
    rows = parser.feed(b"n,t[us],u,y\n7,7000,1,2\n")
    assert rows is not None
    assert (rows.time.tolist(), parser.malformed) == ([pytest.approx(0.007)], 0)


@pytest.mark.parametrize(
    "odd",
    [
        b"",
        b"# a comment",
        b"3,1",
        b"3,1,2,4",
        b"3,x,2",
        b"3,nan,2",
        b"3,1e99,2",
        b"3,1_0,2",
        b"[s],[V]",
        b" 3,1,2\r",
    ],
)
def test_a_thousand_lines_at_once_are_read_as_one_by_one(odd: bytes) -> None:
    lines = [b"%d,%d.5,-1e-%d" % (k, k % 7, k % 9) for k in range(2500)]
    data = b"t,u,y\n" + b"\n".join([*lines[:1200], odd, *lines[1200:]]) + b"\n"
    together, alone = LineParser(), LineParser()
    rows, one_by_one = together.feed(data), [alone.feed(line) for line in data.splitlines(keepends=True)]
    assert rows is not None
    for name in ("time", "number", "input", "output", "broken"):
        np.testing.assert_array_equal(
            getattr(rows, name), np.concatenate([getattr(row, name) for row in one_by_one if row is not None])
        )
    for name in ("lines", "malformed", "not_finite", "example", "columns"):
        assert getattr(together, name) == getattr(alone, name)
