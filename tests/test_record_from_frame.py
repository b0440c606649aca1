"""Records made in Python: of an input alone, and from frames of pandas and Polars."""

from __future__ import annotations

import numpy as np
import pytest

import emsid

COLUMNS = {"t": 0.5 + 0.02 * np.arange(50), "v": np.sin(np.arange(50.0)), "w": np.arange(50) ** 2, "n": np.arange(50)}


def frames(kind):
    if kind == "polars":
        return pytest.importorskip("polars").DataFrame(COLUMNS)
    if kind == "pandas":
        return pytest.importorskip("pandas").DataFrame(COLUMNS)
    return COLUMNS


def test_a_record_of_an_input_alone():
    record = emsid.Record(np.arange(5.0), dt=1e-3)
    assert record.output.shape == (5, 0)
    with pytest.raises(emsid.DataError, match="no sample time"):
        emsid.Record(np.arange(5.0))
    with pytest.raises(emsid.DataError, match="no sample time"):
        emsid.Record(np.arange(5.0), np.arange(5.0))


def test_a_text_is_one_name_and_not_a_list_of_letters():
    record = emsid.Record(
        [0.0, 1.0], [0.0, 1.0], 0.1, input_names="voltage", output_names="speed", input_units="V", output_units="rad/s"
    )
    assert record.input_names == ("voltage",)
    assert record.output_units == ("rad/s",)


@pytest.mark.parametrize("kind", ["dictionary", "polars", "pandas"])
def test_a_record_from_a_frame(kind):
    record = emsid.Record.from_frame(frames(kind), input="v", output=["w", "n"], time="t")
    assert record.dt == 0.02
    assert record.times == (0.5,)
    assert record.output_names == ("w", "n")
    assert np.array_equal(record.input[:, 0], COLUMNS["v"])
    assert np.array_equal(record.output[:, 1], COLUMNS["n"])
    assert emsid.Record.from_frame(frames(kind), input="v", dt=0.1).output.shape == (50, 0)


@pytest.mark.parametrize("kind", ["polars", "pandas"])
def test_dates_and_times_are_seconds(kind):
    moments = np.datetime64("2026-05-01T12:00:00", "ns") + 20_000_000 * np.arange(50).astype("timedelta64[ns]")
    frame = type(frames(kind))({"t": moments, "v": COLUMNS["v"]})
    assert emsid.Record.from_frame(frame, input="v", time="t").dt == 0.02


def test_the_index_of_a_pandas_frame_is_the_time():
    frame = frames("pandas").set_index("t")
    assert emsid.Record.from_frame(frame, input="v", output="w").dt == 0.02
    assert emsid.Record.from_frame(frame, input="v", output="w", time="t").dt == 0.02
    moments = frame.set_axis(np.datetime64("2026-05-01", "ns") + (1e9 * frame.index).astype("timedelta64[ns]"))
    assert emsid.Record.from_frame(moments.tz_localize("UTC"), input="v").dt == pytest.approx(0.02)


def test_units_of_a_frame_are_converted_to_si():
    record = emsid.Record.from_frame(COLUMNS, input="v", output="n", dt=0.02, units={"v": "mV", "n": "rpm"})
    assert record.output[30, 0] == pytest.approx(np.pi)
    assert record.input_units == ("V",)


def test_an_irregular_time_is_resampled_where_that_is_asked_for():
    late = COLUMNS | {"t": np.delete(0.02 * np.arange(51), 20)}
    with pytest.raises(emsid.DataError, match="resample"):
        emsid.Record.from_frame(late, input="v", output="w", time="t")
    assert len(emsid.Record.from_frame(late, input="v", output="w", time="t", resample=True)) == 51


@pytest.mark.parametrize(
    ("wrong", "answer"),
    [
        ({"input": "volt", "dt": 0.1}, "no column 'volt'"),
        ({"input": "v", "output": "speed", "dt": 0.1}, "no column 'speed'"),
        ({"input": "v"}, "give dt"),
        ({"input": "v", "time": "when"}, "no column 'when'"),
        ({"input": "v", "time": "t", "dt": 0.5}, "leave one of them out"),
        ({"input": "v", "output": "v", "dt": 0.1}, "own name"),
        ({"input": "v", "dt": 0.1, "units": {"w": "rpm"}}, "neither input nor output"),
        ({"input": "text", "dt": 0.1}, "numbers"),
    ],
)
def test_what_no_record_can_be_made_of_is_answered(wrong, answer):
    for kind in ("dictionary", "polars", "pandas"):
        frame = type(frames(kind))(COLUMNS | {"text": np.array(["a"] * 50)})
        with pytest.raises(emsid.DataError, match=answer):
            emsid.Record.from_frame(frame, **wrong)


def test_a_frame_that_is_none_is_answered():
    with pytest.raises(emsid.DataError, match="no columns"):
        emsid.Record.from_frame(np.ones((5, 2)), input="v", dt=0.1)
