"""Tables with a row for every value of every signal."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import emsid
from emsid.first_look import describe
from emsid.io.reading import read_columns

N = 400
U = np.repeat(np.random.default_rng(2).integers(-8, 9, N // 10).astype(float), 10)
Y = np.zeros(N)
for k in range(1, N):
    Y[k] = 0.9 * Y[k - 1] + 0.5 * U[k - 1]
T = np.round(0.01 * np.arange(N), 6)
Write = Callable[[str], Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """A file with the text."""

    def write(text: str) -> Path:
        path = tmp_path / "log.csv"
        path.write_text(text)
        return path

    return write


def interleaved(head: str = "time,signal,value", late: float = 0.0) -> str:
    rows = (f"{t},voltage,{u}\n{round(t + late, 6)},speed,{y}\n" for t, u, y in zip(T, U, Y, strict=True))
    return f"{head}\n{''.join(rows)}"


@pytest.mark.parametrize("head", ["time,signal,value", "t_ms,Name,Value", "stamp,variable,val", "_time,_field,_value"])
def test_signals_at_the_same_times_become_the_columns_of_a_table(write: Write, head: str) -> None:
    columns = read_columns(write(interleaved(head)))
    assert list(columns.series) == [head.split(",")[0], "voltage", "speed"]
    assert [series.to_list() for series in columns.series.values()] == [T.tolist(), U.tolist(), Y.tolist()]


def test_one_signal_after_the_other_is_the_same_table(write: Write) -> None:
    late = round(0.004, 3)
    blocks = "".join(f"{t},voltage,{u}\n" for t, u in zip(T, U, strict=True))
    blocks += "".join(f"{round(t + late, 6)},speed,{y}\n" for t, y in zip(T, Y, strict=True))
    one, two = (read_columns(write(text)) for text in (f"time,signal,value\n{blocks}", interleaved(late=late)))
    assert {name: series.to_list() for name, series in one.series.items()} == {
        name: series.to_list() for name, series in two.series.items()
    }


def test_rows_stay_in_order_where_the_time_of_a_signal_begins_again(write: Write) -> None:
    again = [0.0, 0.1, 0.2, 0.05, 0.15, 0.25]
    rows = "".join(f"{t},voltage,{k}\n{t},speed,{-k}\n" for k, t in enumerate(again))
    columns = read_columns(write(f"time,signal,value\n{rows}"))
    assert columns.series["time"].to_list() == again
    assert columns.series["voltage"].to_list() == [0, 1, 2, 3, 4, 5]


def test_signals_at_times_of_their_own_are_read_as_messages(write: Write) -> None:
    path = write(interleaved(late=0.004))
    look = describe(path)
    assert (look.reading["input"], look.reading["output"], look.reading["time"]) == ("voltage", "speed", "time")
    assert "rows-of-messages" in [finding.code for finding in look.findings]
    record = emsid.read(path, **look.reading)
    assert record.input[:, 0] == pytest.approx(U[:-1])  # no input after the last one
    assert record.output[:, 0] == pytest.approx(Y[:-1])


def test_a_column_of_units_gives_those_of_the_signals(write: Write) -> None:
    rows = "".join(f"{t};u;{u};V\n{t};n;{y};rad/s\n" for t, u, y in zip(T, U, Y, strict=True))
    columns = read_columns(write(f"Zeit;Signal;Wert;Einheit\n{rows}"))
    assert columns.units == {"u": "V", "n": "rad/s"}


def test_a_time_that_is_repeated_in_a_signal_loses_no_value(write: Write) -> None:
    rows = "".join(f"{k // 2},u,{k}\n{k // 2},y,{-k}\n" for k in range(20))
    columns = read_columns(write(f"time,signal,value\n{rows}"))
    assert columns.series["u"].to_list() == list(range(20))


@pytest.mark.parametrize(
    "head",
    ["time,state,speed", "time,state,voltage"],
)
def test_a_column_of_texts_beside_a_signal_is_no_long_form(write: Write, head: str) -> None:
    columns = read_columns(write(interleaved(head)))
    assert list(columns.series) == head.split(",")
    assert len(columns.series["time"]) == 2 * N


def test_values_with_many_different_texts_are_no_long_form(write: Write) -> None:
    rows = "".join(f"{t},note {k},{y}\n" for k, (t, y) in enumerate(zip(T, Y, strict=True)))
    assert list(read_columns(write(f"time,comment,value\n{rows}")).series) == ["time", "comment", "value"]


def test_json_objects_a_line_have_a_suffix_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "log.jsonl"
    path.write_text("".join(f'{{"t": {t}, "u": {u}}}\n' for t, u in zip(T, U, strict=True)))
    assert read_columns(path).series["u"].to_list() == U.tolist()
