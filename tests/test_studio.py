"""The studio behind its guard: who may ask, what is refused, and that a page's state gives the command's numbers."""

from __future__ import annotations

import io
import re
import shlex
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from shutil import copytree
from threading import Event
from typing import Any

import msgspec
import numpy as np
import pytest

pytest.importorskip("starlette")
from starlette.testclient import TestClient

import emsid
from emsid.cli.commands.studio import command_of, track_of
from emsid.errors import DataError, FormatError
from emsid.findings import Finding
from emsid.record import Record
from emsid.studio import uplot, worker
from emsid.studio.data import EDITS, Signal, edit_for, packed
from emsid.studio.live import Live
from emsid.studio.runs import Runs
from emsid.studio.server import POLICY, SMALL, Messages, application, last_door, private
from emsid.studio.session import Session
from emsid.studio.studio import Studio
from emsid.studio.use import input_of
from emsid.study.demonstration import EXAMPLES
from emsid.wording import CATALOGUE

TOKEN = "token-of-the-test"
ORIGIN = "http://127.0.0.1:8000"


@contextmanager
def studio_in(folder: Path) -> Iterator[tuple[TestClient, Studio]]:
    messages = Messages()
    session = Session.at_folder(folder)
    studio = Studio(session, Runs(session, messages.announce), Live(session, messages.announce, track_of), command_of)
    with TestClient(application(studio, messages, TOKEN, 8000), base_url=ORIGIN) as client:
        client.base_url = client.base_url.join(f"/{TOKEN}/")
        yield client, studio
        studio.runs.close()


@pytest.fixture
def opened(tmp_path: Path) -> Iterator[tuple[TestClient, Studio]]:
    with studio_in(tmp_path / "session") as both:
        yield both


def table(rows: int = 400, name: str = "speed") -> bytes:
    rng = np.random.default_rng(3)
    u = np.repeat(rng.uniform(-5, 5, rows // 10), 10)
    y = np.zeros(rows)
    for t in range(1, rows):
        y[t] = 0.9 * y[t - 1] + 0.5 * u[t - 1]
    y += 0.01 * rng.standard_normal(rows)
    lines = [
        f't,voltage,"{name}"',
        *(f"{k / 100:.2f},{a:.5f},{b:.5f}" for k, (a, b) in enumerate(zip(u, y, strict=True))),
    ]
    return "\n".join(lines).encode()


def state(client: TestClient) -> dict[str, Any]:
    found: dict[str, Any] = client.get("api/state").json()
    return found


def look(client: TestClient, file: str = "log.csv") -> dict[str, Any]:
    """What the page shows of a file."""
    answer = client.get("api/data", params={"file": file})
    assert answer.status_code == 200, answer.text
    found: dict[str, Any] = answer.json()
    return found


def window(client: TestClient, columns: list[str], first: float, last: float, **more: Any) -> Any:
    """(1 + columns, points) times and values of columns of the file, as the page draws them."""
    asked = {"file": "log.csv", "columns": columns, "from": first, "to": last, "width": 2000, **more}
    answer = client.post("api/window", json=asked)
    assert answer.status_code == 200, answer.text
    return np.frombuffer(answer.content[4:], "<f4").reshape(1 + len(columns), -1)


def finished(client: TestClient, number: str, limit: float = 120.0) -> dict[str, Any]:
    until = time.monotonic() + limit
    while time.monotonic() < until:
        run = next(each for each in state(client)["runs"] if each["number"] == number)
        if run["state"] not in ("running", "waiting"):
            return run
        time.sleep(0.1)
    raise AssertionError("the run did not end")


@pytest.fixture(scope="module")
def session_of_a_fit(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a session in which one model was fitted."""
    folder = tmp_path_factory.mktemp("fitted") / "session"
    with studio_in(folder) as (client, _):
        client.post("api/files?name=log.csv", content=table())
        client.post("api/edit", json={"models": ["arx"], "options": {"na": "1", "nb": "1", "nk": "1"}, "unseen": 0.25})
        assert finished(client, client.post("api/run").json()["run"])["state"] == "done"
    return folder


@pytest.fixture
def fitted(session_of_a_fit: Path, tmp_path: Path) -> Iterator[tuple[TestClient, Studio]]:
    """A session of its own with one fit."""
    with studio_in(Path(copytree(session_of_a_fit, tmp_path / "session"))) as both:
        yield both


# --- who may ask ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        ("/api/state", {}),
        ("/wrong/api/state", {}),
        (f"/{TOKEN}x/api/state", {}),
        ("/", {}),
        (f"/{TOKEN}/api/state", {"host": "evil.example:8000"}),
        (f"/{TOKEN}/api/state", {"host": "127.0.0.1:8001"}),
        (f"/{TOKEN}/api/state", {"origin": "http://evil.example"}),
        (f"/{TOKEN}/api/state", {"origin": "null"}),
    ],
)
def test_requests_without_token_or_from_elsewhere_are_refused(opened: Any, path: str, headers: dict[str, str]) -> None:
    answer = opened[0].get(f"{ORIGIN}{path}", headers=headers)
    assert answer.status_code == 403
    assert answer.headers["content-security-policy"] == POLICY


@pytest.mark.parametrize("path", ["page/../../session.json", "page/%2e%2e/session.py", "page/..%2f..%2fsession.py"])
def test_no_path_leaves_the_page(opened: Any, path: str) -> None:
    assert opened[0].get(path).status_code in (403, 404)
    assert opened[0].get("page/main.js").status_code == 200


def test_page_is_served_with_a_policy_that_runs_no_text(opened: Any) -> None:
    answer = opened[0].get("")
    assert "emsid studio" in answer.text
    assert "unsafe" not in answer.headers["content-security-policy"]
    assert not any(mark in answer.text for mark in ("<script>", "style=", "onclick"))


def test_large_requests_are_refused_by_their_length_and_while_they_arrive(opened: Any) -> None:
    client, _ = opened
    assert client.post("api/edit", content=b" " * (SMALL + 1)).status_code == 413

    def blocks() -> Iterator[bytes]:
        for _ in range(100):
            yield b" " * SMALL

    assert client.post("api/edit", content=blocks()).status_code == 413
    assert state(client)["step"]["files"] == []


@pytest.mark.parametrize("body", [b"{", b"[1]", b'{"unknown": 1}', b'{"files": ["../session.json"]}', b'{"unseen": 2}'])
def test_requests_that_are_not_understood_change_nothing(opened: Any, body: bytes) -> None:
    client, studio = opened
    assert client.post("api/edit", content=body).status_code == 400
    assert len(studio.session.steps) == 1


# --- data -------------------------------------------------------------------------------------------------------------


def test_a_dropped_file_is_described_corrected_and_taken_back(opened: Any) -> None:
    client, _ = opened
    assert client.post("api/files?name=../../log.csv", content=table()).status_code == 200
    found = state(client)
    assert found["step"]["files"] == ["log.csv"]
    reading = look(client)["reading"]
    assert (reading["input"], reading["output"]) == ("voltage", "speed")
    assert client.post("api/edit", json={"given": {"units": {"speed": "rpm"}}}).status_code == 200
    assert state(client)["records"][0]["channels"][1]["unit"] == "rad/s"
    assert client.post("api/edit", json={"given": {"output": "no such"}}).status_code == 400
    client.post("api/undo")
    assert state(client)["step"]["given"] == {}
    client.post("api/redo")
    assert state(client)["step"]["given"] == {"log.csv": {"units": {"speed": "rpm"}}}


def test_brush_masks_cuts_and_splits_at_the_rows_of_the_file(opened: Any) -> None:
    client, studio = opened
    client.post("api/files?name=log.csv", content=table())
    ask = {"file": "log.csv", "first": 1.0, "last": 1.49}
    assert client.post("api/brush", json={"kind": "mask", **ask}).status_code == 200
    assert studio.session.step["given"]["log.csv"]["mask"] == "row >= 100 AND row < 150"
    record = state(client)["records"][0]
    assert record["samples"] == 350
    assert any(mark["kind"] == "gap" and mark["first"] == pytest.approx(0.99) for mark in look(client)["marks"])
    client.post("api/brush", json={"kind": "mask", "file": "log.csv", "first": 2.0, "last": 2.09})
    assert state(client)["records"][0]["samples"] == 340
    client.post("api/brush", json={"kind": "cut", "file": "log.csv", "first": 0.5, "last": 3.0})
    assert studio.session.step["given"]["log.csv"]["rows"] == [50, 301]
    client.post("api/brush", json={"kind": "split", "file": "log.csv", "first": 2.5, "last": 3.0})
    assert studio.session.step["unseen"] == pytest.approx(51 / 191)


def test_jitter_is_marked_where_it_is_with_its_sentence(opened: Any) -> None:
    rng, (client, _) = np.random.default_rng(0), opened
    t = 5 + np.arange(400) * 0.01
    t[200:300] += rng.uniform(-2e-3, 2e-3, 100)
    u = np.repeat(rng.uniform(-5, 5, 40), 10)
    rows = [f"{1000 * a:.3f},{b:.3f},{c:.4f}" for a, b, c in zip(t, u, np.cumsum(u) / 100, strict=True)]
    client.post("api/files?name=log.csv", content="\n".join(["t[ms],voltage,speed", *rows]).encode())
    marks = [each for each in look(client)["marks"] if each["kind"] == "jitter"]
    assert marks
    assert all(6.98 < mark["first"] < mark["last"] < 8.02 for mark in marks)
    assert "jitter" in marks[0]["text"]


def rgb(color: str) -> Any:
    return np.array([int(color[k : k + 2], 16) for k in (1, 3, 5)]) / 255


def contrast(one: str, other: str) -> float:
    """Ratio of the relative luminances of two colours, as WCAG 2 defines it."""
    ends = []
    for color in (one, other):
        x = rgb(color)
        linear = np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)
        ends.append(float(linear @ [0.2126, 0.7152, 0.0722]) + 0.05)
    return max(ends) / min(ends)


@pytest.mark.parametrize("dark", [False, True])
def test_text_and_lines_have_a_contrast_of_4_5(dark: bool) -> None:
    style = (Path(uplot.__file__).parent / "page" / "style.css").read_text("utf-8")
    light, _, darker = style.partition("@media (prefers-color-scheme: dark)")
    assert contrast("#000000", "#ffffff") == pytest.approx(21)
    colors = dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6})", light))
    if dark:
        colors |= dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6})", darker))
    inks = ["ink", "quiet", "link", "accent", "warn", "bad", "good", *(f"s{k}" for k in range(6))]
    low = {(a, b): contrast(colors[a], colors[b]) for a in inks for b in ("paper", "panel")}
    low["on-accent", "accent"] = contrast(colors["on-accent"], colors["accent"])
    assert {pair: ratio for pair, ratio in low.items() if ratio < 4.5} == {}
    assert colors.keys() == {*inks, "paper", "panel", "edge", "on-accent"}  # a new colour is checked too


def test_hostile_names_of_columns_remain_text(opened: Any) -> None:
    client, _ = opened
    client.post("api/files?name=log.csv", content=table(name="<img src=x onerror=alert(1)>"))
    answer = client.get("api/data?file=log.csv")
    assert answer.headers["content-type"] == "application/json"
    assert "<img src=x onerror=alert(1)>" in answer.json()["rows"][2][0]


# --- windows ----------------------------------------------------------------------------------------------------------


def test_window_shows_the_extremes_of_every_pixel_and_gaps() -> None:
    rng = np.random.default_rng(0)
    x, t = rng.standard_normal(100_000), np.arange(100_000) * 1e-3
    x[54_321] = 99.0
    t[60_000:] += 30.0
    times, values = Signal(t, x, 1e-3).window(0.0, 130.0, 500)
    assert np.nanmax(values) == 99.0
    assert np.nanmin(values) == x.min()
    assert np.isnan(values).sum() == 1
    assert len(times) <= 1002
    near, all_of_them = Signal(t, x, 1e-3).window(10.0, 10.1, 500)
    assert np.array_equal(all_of_them, x[9_999:10_102][: len(near)])


def test_window_of_two_million_samples_is_fast() -> None:
    signal = Signal(np.arange(2_000_000) * 1e-3, np.random.default_rng(0).standard_normal(2_000_000), 1e-3)
    begun = time.process_time()
    content = packed([signal], 0.0, 2000.0, 1200)
    assert time.process_time() - begun < 0.05
    assert len(content) == 4 + 2 * 4 * 2400


# --- fits -------------------------------------------------------------------------------------------------------------


def test_a_fit_its_free_runs_its_play_and_its_command_give_the_same_numbers(
    fitted: Any, tmp_path: Path, command: Callable[..., int]
) -> None:
    client, studio = fitted
    number = state(client)["runs"][0]["number"]
    shown = client.get(f"api/runs/{number}/shown").json()
    assert shown["ranking"][0]["fit"] > 99
    model, data = f"{number}/arx", {"file": "log.csv", "part": "unseen"}
    ranking = client.post("api/ranking", json={"models": [model], "data": data}).json()
    assert ranking["rows"][0]["fit"] == pytest.approx(shown["ranking"][0]["fit"])
    assert ranking["rows"][0]["data"] == "unseen"
    drawn = {"models": [model], "data": data, "from": 3, "to": 4, "width": 2000}
    _, measured, simulated, left = np.frombuffer(client.post("api/runs", json=drawn).content[4:], "<f4").reshape(4, -1)
    assert np.ptp(measured) > 1
    assert left[1:] == pytest.approx((measured - simulated)[1:], abs=1e-5)
    values = {each["name"]: each["value"] for each in client.get(f"api/about?model={model}").json()["sliders"]}
    asked = {"model": model, "data": data, "input": {"kind": "step", "amplitude": 2, "duration": 2}, "width": 2000}
    step = np.frombuffer(client.post("api/play", json={**asked, "values": values}).content[20:], "<f4").reshape(4, -1)
    assert step[2, -1] == pytest.approx(2 * 5.0, rel=0.02)
    assert client.post("api/play", json={**asked, "values": {"no": 1}}).status_code == 400
    assert client.get(f"api/runs/{number}/file/report.html").status_code == 200
    assert client.get(f"api/runs/{number}/file/../../session.json").status_code != 200
    content = client.post("api/export", json={"model": model, "format": "c99"}).content
    assert any(name.endswith(".c") for name in zipfile.ZipFile(io.BytesIO(content)).namelist())
    own = (studio.session.folder / "runs" / number / "result.json").read_bytes()
    words = shlex.split(state(client)["command"])
    assert command(*words[1:], "--out", tmp_path / "again", "--json") == 0
    assert fits(own) == fits((tmp_path / "again" / "result.json").read_bytes())
    names: dict[str, Any] = {}
    exec(state(client)["script"], names)
    assert fits(own) == fits(msgspec.json.encode(names["result"].to_data()))


def fits(content: bytes) -> Any:
    found = msgspec.json.decode(content)
    return found["fits"], found["rows"]


def test_a_killed_worker_loses_no_finished_run_and_a_session_is_reopened(
    session_of_a_fit: Path, tmp_path: Path
) -> None:
    folder = Path(copytree(session_of_a_fit, tmp_path / "s"))
    with studio_in(folder) as (client, studio):
        second = client.post("api/run").json()["run"]
        while studio.runs._processes.get(second) is None:
            time.sleep(0.01)
        studio.runs._processes[second].kill()  # type: ignore[union-attr]
        assert finished(client, second)["state"] == "ended"
    with studio_in(folder) as (client, _):
        found = state(client)
        assert [run["state"] for run in found["runs"]] == ["ended", "done"]
        assert found["step"]["models"] == ["arx"]


def test_a_folder_that_is_no_session_is_refused(tmp_path: Path) -> None:
    (tmp_path / "session.json").write_text('{"format": "other"}')
    with pytest.raises(FormatError, match="choose another folder"):
        Session.at_folder(tmp_path)


def test_inputs_of_play_are_checked() -> None:
    own = np.zeros((5, 1))
    assert input_of({"kind": "sine", "amplitude": 3, "duration": 1}, own, 0.001)[:, 0].max() == pytest.approx(
        3, rel=1e-3
    )
    drawn = input_of({"kind": "drawn", "duration": 1, "points": [[0, 0], [1, 2]]}, own, 0.01)
    assert drawn[50, 0] == pytest.approx(1.0)
    for wrong in ({"kind": "other"}, {"kind": "drawn", "points": "x"}, {"kind": "step", "amplitude": "nan"}):
        with pytest.raises(DataError):
            input_of(wrong, own, 0.01)


@pytest.mark.parametrize(("model", "instead"), [("arx", "output-error"), ("friction-narx", "friction-narx-free-run")])
def test_a_finding_proposes_the_models_that_its_button_fits(model: str, instead: str) -> None:
    record = Record(np.arange(4.0), np.arange(4.0), 0.1)
    assert edit_for(Finding("regression-biased", data={"model": model}), record) == {"models": [instead]}
    assert set(EDITS) <= set(CATALOGUE)


def test_a_current_beside_the_speed_is_proposed_as_output(opened: Any) -> None:
    client, rows = opened[0], table().decode().splitlines()
    values = [line.split(",") for line in rows[1:]]
    current = [f"{(float(u) - 0.15 * float(y)) / 2:.5f}" for _, u, y in values]
    text = [f"{rows[0]},current", *(f"{line},{i}" for line, i in zip(rows[1:], current, strict=True))]
    client.post("api/files?name=log.csv", content="\n".join(text).encode())
    (given,) = (each["given"] for each in look(client)["findings"] if each["given"])
    assert given == {"output": ["speed", "current"]}
    client.post("api/edit", json={"given": given})
    assert [each["name"] for each in state(client)["records"][0]["channels"]] == ["voltage", "speed", "current"]


def test_uplot_of_another_checksum_is_not_installed() -> None:
    with pytest.raises(uplot.NotFetched, match="checksum"):
        uplot.unpack(b"other")


def test_without_npm_one_line_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(uplot, "PLACE", tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(SystemExit) as end:
        uplot.main()
    assert (end.value.code, capsys.readouterr().err.count("\n")) == (2, 1)
    assert not list(tmp_path.iterdir())


def test_own_code_of_the_page_is_small() -> None:
    page = Path(uplot.__file__).parent / "page"
    assert sum(path.stat().st_size for path in page.iterdir() if path.suffix in (".js", ".css")) < 120_000
    for path in page.glob("*.js"):
        assert "innerHTML" not in path.read_text("utf-8")


def test_a_change_of_a_state_that_has_changed_is_refused(opened: tuple[TestClient, Studio]) -> None:
    client, studio = opened
    version = client.get("api/state").json()["version"]
    made = client.post("api/edit", json={"unseen": 0.4}, headers={"If-Match": str(version)})
    assert made.json() == {"version": version + 1}
    for path, content in (
        ("edit", {"unseen": 0.5}),
        ("undo", {}),
        ("redo", {}),
        ("run", {}),
        ("example", {"name": "x"}),
    ):
        stale = client.post(f"api/{path}", json=content, headers={"If-Match": str(version)})
        assert stale.status_code == 409, path
    assert studio.session.step["unseen"] == 0.4
    assert client.post("api/undo", headers={"If-Match": str(version + 1)}).status_code == 200


def test_an_edit_that_is_checked_while_another_is_made_is_refused(
    opened: tuple[TestClient, Studio], monkeypatch: pytest.MonkeyPatch
) -> None:
    client, studio = opened
    assert client.post(
        "api/example", json={"name": client.get("api/catalogue").json()["examples"][0]["name"]}
    ).is_success
    record = studio.data.record

    def undone_meanwhile(step: dict[str, Any], name: str) -> Any:
        found = record(step, name)
        monkeypatch.undo()
        studio.move(-1)
        return found

    monkeypatch.setattr(studio.data, "record", undone_meanwhile)
    assert client.post("api/edit", json={"given": {"mask": "row < 20"}}).status_code == 409
    assert studio.session.step["given"] == {}
    assert studio.session.step["files"] == []


def test_a_refused_file_does_not_stay(opened: tuple[TestClient, Studio]) -> None:
    client, studio = opened
    assert client.post("api/files?name=bad.npz", content=b"no archive").status_code == 400
    assert list((studio.session.folder / "data").iterdir()) == []


@pytest.mark.parametrize(
    "steps",
    [[], [3], [{"files": ["../../secret.csv"]}], [{"files": "log.csv"}], [{"unseen": None}], [{"given": []}]],
)
def test_a_session_file_that_is_none_or_names_other_files_is_refused(tmp_path: Path, steps: Any) -> None:
    document = {"format": "emsid session", "version": 1, "at": 0, "steps": steps}
    (tmp_path / "session.json").write_bytes(msgspec.json.encode(document))
    with pytest.raises(FormatError, match="not a session"):
        Session.at_folder(tmp_path)


def test_deep_json_is_no_session_and_a_session_is_private(tmp_path: Path) -> None:
    Session.at_folder(tmp_path / "new")
    assert (tmp_path / "new").stat().st_mode & 0o777 == 0o700
    (tmp_path / "session.json").write_text("[" * 100_000)
    with pytest.raises(FormatError, match="not a session"):
        Session.at_folder(tmp_path)


def test_deep_json_and_long_names_are_answered_in_one_line(opened: tuple[TestClient, Studio]) -> None:
    client, _ = opened
    assert client.post("api/edit", content=b'{"given":' + b"[" * 100_000).status_code == 400
    assert client.post("api/files?name=" + "%F0%9F%98%80" * 120, content=b"a,b\n1,2\n").status_code in (200, 400)
    assert client.post("api/files?name=%00", content=b"x").status_code == 400
    assert client.get("api/runs/1/file/%00").status_code in (400, 404)
    assert client.get("page/%00").status_code in (400, 404)


# --- what is said of a record stays with it ---------------------------------------------------------------------------


def other_table(rows: int = 400) -> bytes:
    """The same motor with other names of columns."""
    return table(rows).replace(b't,voltage,"speed"', b"time,u1,omega")


def test_settings_of_an_example_are_not_of_a_file_that_is_added(opened: tuple[TestClient, Studio]) -> None:
    client, studio = opened
    client.post("api/example", json={"name": "motor"})
    example = studio.session.step["files"][0]
    for edit in (
        {"given": {"input": "voltage", "units": {"voltage": "V"}, "rows": [0, 900]}},
        {"models": ["arx"], "unseen": 0.4, "options": {"na": "1", "fixed": {"resistance": "2 ohm"}}},
    ):
        assert client.post("api/edit", json=edit).status_code == 200
    client.post("api/files?name=own.csv", content=other_table())
    found = state(client)
    assert found["step"]["options"] == {"na": 1, "fixed": {"resistance": "2 ohm"}}  # a further record of it
    own = found["records"][1]
    assert "problem" not in own
    assert "or remove one of the files" in own["unlike"]
    assert (own["samples"], [each["name"] for each in own["channels"]]) == (400, ["u1", "omega"])
    assert client.post("api/edit", json={"files": ["own.csv"]}).status_code == 200  # remove
    found = state(client)
    assert found["step"]["files"] == ["own.csv"]
    assert (found["step"]["given"], found["step"]["models"], found["step"]["options"]) == ({}, [], {})
    assert found["step"]["unseen"] == 0.3
    assert look(client, "own.csv")["reading"]["input"] == "u1"
    assert not found["problem"]
    client.post("api/undo")
    assert studio.session.step["given"][example]["units"] == {"voltage": "V"}
    assert studio.session.step["options"]["fixed"] == {"resistance": "2 ohm"}


def test_known_values_stay_with_the_files_that_they_were_said_of(opened: tuple[TestClient, Studio]) -> None:
    client, studio = opened
    for name in ("a.csv", "b.csv"):
        client.post(f"api/files?name={name}", content=table())
    client.post("api/edit", json={"options": {"fixed": {"resistance": "2 ohm"}}})
    client.post("api/files?name=c.csv", content=table())
    client.post("api/edit", json={"files": ["b.csv", "c.csv"]})
    assert studio.session.step["options"] == {"fixed": {"resistance": "2 ohm"}}
    client.post("api/edit", json={"files": ["c.csv"]})
    assert studio.session.step["options"] == {}


def test_a_mask_concerns_the_record_on_which_it_was_drawn(opened: tuple[TestClient, Studio]) -> None:
    client, _ = opened
    for name in ("a.csv", "b.csv"):
        client.post(f"api/files?name={name}", content=table())
    client.post("api/brush", json={"kind": "mask", "file": "b.csv", "first": 1.0, "last": 1.49})
    client.post("api/edit", json={"given": {"units": {"speed": "rpm"}}})
    client.post("api/brush", json={"kind": "cut", "file": "a.csv", "first": 0.5, "last": 2.99})
    found = state(client)
    assert [record["samples"] for record in found["records"]] == [250, 350]
    assert [record["channels"][1]["unit"] for record in found["records"]] == ["rad/s", "rad/s"]
    assert "command" not in found  # it would read both files in one way
    assert found["script"].count("mask=") == 1


def test_the_script_of_files_that_are_read_differently_runs_from_any_folder(
    opened: tuple[TestClient, Studio], tmp_path: Path
) -> None:
    client = opened[0]
    for name in ("a 'b'.csv", "c.csv"):
        client.post(f"api/files?name={name}", content=table())
    client.post("api/edit", json={"given": {"units": {"voltage": "V", "speed": "rad/s"}}})
    client.post("api/brush", json={"kind": "mask", "file": "c.csv", "first": 1.0, "last": 1.49})
    client.post("api/files?name=d.csv&unseen=1", content=table(300))
    fixed = {"resistance": "2 ohm ± 5 %"}
    client.post("api/edit", json={"models": ["arx", "rigid-motor"], "options": {"na": "1", "fixed": fixed}})
    script = tmp_path / "fit.py"
    script.write_text(state(client)["script"], "utf-8")
    (tmp_path / "elsewhere").mkdir()
    done = subprocess.run(
        [sys.executable, "-W", "error", script], cwd=tmp_path / "elsewhere", capture_output=True, text=True, timeout=120
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "rigid-motor" in done.stdout


def test_results_of_other_data_are_marked(fitted: tuple[TestClient, Studio], monkeypatch: pytest.MonkeyPatch) -> None:
    client, studio = fitted

    def stale() -> list[str]:
        (run,) = state(client)["runs"]
        found: list[str] = run["stale"]
        return found

    assert stale() == []
    client.post("api/edit", json={"models": ["output-error"]})
    assert stale() == []  # of the same data
    client.post("api/brush", json={"kind": "mask", "file": "log.csv", "first": 1.0, "last": 1.49})
    assert stale() == ["mask"]
    client.post("api/undo")
    assert stale() == []
    client.post("api/edit", json={"unseen": 0.4})
    assert stale() == ["part kept unseen"]
    client.post("api/undo")
    client.post("api/files?name=more.csv", content=table())
    assert stale() == ["files"]
    client.post("api/undo")
    path = studio.session.path("log.csv")
    path.write_bytes(table().replace(b"0.02,", b"0.020,"))
    assert stale() == ["content of log.csv"]
    path.write_bytes(table())
    assert stale() == []
    monkeypatch.setattr("emsid.__version__", "0.0.1")
    assert stale() == ["version of emsid"]
    client.post("api/edit", json={"files": []})
    assert stale() == ["data"]


def test_a_file_is_read_again_once_it_has_changed(opened: tuple[TestClient, Studio]) -> None:
    client, studio = opened
    client.post("api/files?name=log.csv", content=table(400))
    assert state(client)["records"][0]["samples"] == 400
    before = window(client, ["speed"], 0, 4).shape[1]
    studio.session.path("log.csv").write_bytes(table(300))
    assert state(client)["records"][0]["samples"] == 300
    assert (before, window(client, ["speed"], 0, 4).shape[1]) == (400, 300)


def test_a_session_of_the_first_version_is_read(tmp_path: Path) -> None:
    step = {"files": ["a.csv", "b.csv"], "given": {"units": {"speed": "rpm"}}, "models": ["arx"]}
    document = {"format": "emsid session", "version": 1, "at": 1, "steps": [{}, step]}
    (tmp_path / "session.json").write_bytes(msgspec.json.encode(document))
    session = Session.at_folder(tmp_path)
    assert session.step["given"] == {"a.csv": {"units": {"speed": "rpm"}}}
    assert (session.step["chosen_for"], session.step["models"]) == (["a.csv", "b.csv"], ["arx"])
    assert msgspec.json.decode((tmp_path / "session.json").read_bytes())["version"] == 3


# --- datasets, preparation and views ----------------------------------------------------------------------------------


def test_every_dataset_has_its_own_reading_and_place(opened: tuple[TestClient, Studio]) -> None:
    client, _ = opened
    for name, kind in (("a.csv", "files"), ("b.csv", "other_files"), ("c.csv", "unseen_files")):
        assert client.post(f"api/files?name={name}&kind={kind}", content=table()).status_code == 200
    found = state(client)
    assert [(each["file"], each["kind"]) for each in found["records"]] == [
        ("a.csv", "files"),
        ("c.csv", "unseen_files"),
        ("b.csv", "other_files"),
    ]
    assert client.post("api/edit", json={"file": "b.csv", "given": {"decimate": "4"}}).status_code == 200
    client.post("api/brush", json={"kind": "cut", "file": "c.csv", "first": 1.0, "last": 1.99})
    assert {each["file"]: each["samples"] for each in state(client)["records"]} == {
        "a.csv": 400,
        "b.csv": 100,
        "c.csv": 100,
    }
    assert client.post("api/edit", json={"other_files": ["a.csv"], "files": ["b.csv"]}).status_code == 200
    assert "b.csv" in state(client)["script"]
    assert client.post("api/edit", json={"files": [], "other_files": ["a.csv", "b.csv"]}).status_code == 400
    assert state(client)["step"]["unseen_files"] == ["c.csv"]


def test_what_is_typed_is_drawn_before_it_is_taken_and_refused_by_the_name_of_its_field(opened: Any) -> None:
    client, studio = opened
    client.post("api/files?name=log.csv", content=table())
    t, before = window(client, ["speed"], 0, 4)
    _, after = window(client, ["speed"], 0, 4, given={"scale": "speed = -2"})
    assert after == pytest.approx(-2 * before, rel=1e-5)
    _, smooth = window(client, ["speed"], 0, 4, given={"filter": "1"})
    asked = {"file": "log.csv", "columns": ["speed"], "from": 0, "to": 4, "width": 9, "given": {"filter": "fast"}}
    assert client.post("api/window", json=asked).content == bytes(4)  # it is not there yet
    assert np.std(np.diff(smooth)) < 0.5 * np.std(np.diff(before))
    assert (studio.session.step["given"], len(t)) == ({}, 400)
    answer = client.post("api/edit", json={"given": {"filter": "fast"}})
    assert (answer.status_code, answer.text.startswith("“Filter”: 'fast' is not understood")) == (400, True)
    assert client.post("api/edit", json={"given": {"rows": "10:60", "scale": "speed=2"}}).status_code == 200
    assert studio.session.step["given"]["log.csv"] == {"rows": [10, 60], "scale": {"speed": 2.0}}
    assert "--" not in "".join(each["text"] for each in look(client)["findings"])  # terms of the page


def test_any_column_is_drawn_also_against_another(opened: Any) -> None:
    client, _ = opened
    content = table().replace(b't,voltage,"speed"', b"t,voltage,speed,third").splitlines()
    rows = [line if k == 0 else line + f",{k - 1}".encode() for k, line in enumerate(content)]
    client.post("api/files?name=log.csv", content=b"\n".join(rows))
    client.post("api/edit", json={"given": {"input": "voltage", "output": "speed", "mask": "row < 100"}})
    t, third = window(client, ["third"], 0, 4)
    assert third == pytest.approx(np.arange(100, 400))
    assert t == pytest.approx(np.arange(100, 400) / 100, abs=1e-5)
    asked = {"file": "log.csv", "columns": ["third", "voltage"], "from": 1.5, "to": 2.5}
    x, y = np.frombuffer(client.post("api/pairs", json=asked).content[4:], "<f4").reshape(2, -1)
    assert (x[0], x[-1], np.ptp(y) > 0) == (150, 250, True)


def test_a_correction_of_a_long_file_does_not_wait_for_its_look(
    opened: tuple[TestClient, Studio], monkeypatch: pytest.MonkeyPatch
) -> None:
    client, studio = opened
    monkeypatch.setattr("emsid.studio.data.LONG", 100)
    monkeypatch.setattr("emsid.studio.data.PAUSE", 0.0)
    client.post("api/files?name=log.csv", content=table())
    release, describe = Event(), emsid.describe

    def slow(*arguments: Any, **options: Any) -> Any:
        assert release.wait(60)
        return describe(*arguments, **options)

    monkeypatch.setattr("emsid.describe", slow)
    assert client.post("api/edit", json={"given": {"mask": "row < 100", "units": {"speed": "rpm"}}}).status_code == 200
    (record,) = state(client)["records"]
    assert (record["samples"], record["channels"][1]["unit"], look(client)["looking"]) == (300, "rad/s", True)
    release.set()
    until = time.monotonic() + 60
    while look(client)["looking"]:
        assert time.monotonic() < until
        time.sleep(0.05)
    assert state(client)["records"] == [{**record, "look": 2}]
    assert client.post("api/undo").status_code == 200
    assert studio.data.reading(studio.session.step, "log.csv").get("mask") is None
    assert state(client)["records"][0]["samples"] == 400


def test_the_reading_with_which_an_example_opens_is_that_of_its_first_look(tmp_path: Path) -> None:
    for example in EXAMPLES:
        emsid.write_record(example.record(), tmp_path / f"{example.name}.csv")
        look = emsid.describe(tmp_path / f"{example.name}.csv")
        assert (look.reading, look.mends) == (example.reading, {})


def test_a_long_file_opens_with_a_look_at_an_excerpt_and_is_looked_at_in_another_process(
    opened: tuple[TestClient, Studio], monkeypatch: pytest.MonkeyPatch
) -> None:
    client, studio = opened
    monkeypatch.setattr("emsid.studio.data.LONG", 100)
    monkeypatch.setattr("emsid.studio.data.EXCERPT", 800)
    monkeypatch.setattr("emsid.studio.data.PAUSE", 0.0)
    content = table(4000).splitlines()
    content[3005] = content[3005].rpartition(b",")[0] + b",900.0"
    client.post("api/files?name=log.csv", content=b"\n".join(content))
    first = look(client)
    assert (first["looking"], "of which" in first["caption"]) == (True, True)
    assert state(client)["records"][0]["samples"] == 3999  # an excerpt has the extremes; the outlier is left out
    until = time.monotonic() + 120
    while look(client)["looking"]:
        assert time.monotonic() < until
        time.sleep(0.1)
    whole = emsid.describe(studio.session.path("log.csv"))
    found = look(client)
    assert "of which" not in found["caption"]
    assert [each["code"] for each in found["findings"]] == [each.code for each in whole.findings]


def test_views_overlay_models_of_runs_and_of_files_in_their_colours(fitted: tuple[TestClient, Studio]) -> None:
    client, studio = fitted
    number = state(client)["runs"][0]["number"]
    content = client.get(f"api/model?model={number}/arx").content
    assert client.post("api/models?name=other.json", content=b"{}").status_code == 400
    assert client.post("api/models?name=other.json", content=content).status_code == 200
    models = state(client)["models"]
    assert [(each["id"], each["number"]) for each in models] == [(f"{number}/arx", 0), ("files/other.json", 1)]
    assert models[0]["verdict"]["level"] in ("supported", "limited", "implausible", "unusable")
    names, data = [each["id"] for each in models], {"file": "log.csv", "part": "all"}

    def view(name: str, **more: Any) -> Any:
        answer = client.post("api/view", json={"view": name, "models": names, "data": data, **more})
        assert answer.status_code == 200, answer.text
        found = answer.json()
        assert found["problems"] == {}
        assert sorted(found["inks"].values()) == [0, 1]
        return found["plots"]

    (step,) = view("step", size=2.0)
    lines = [mark for mark in step["marks"] if mark["kind"] == "line"]
    assert [line["label"] for line in lines] == [f"arx (run {number})", "other"]
    assert lines[0]["y"][-1] == pytest.approx(2 * 5.0, rel=0.02)
    magnitude, phase, coherence = view("bode")
    assert [plot["y"]["title"].split()[0] for plot in (magnitude, phase, coherence)] == [
        "Magnitude",
        "Phase",
        "Coherence",
    ]
    assert magnitude["x"]["log"]
    assert "the data" in [mark.get("label") for mark in magnitude["marks"]]
    (poles,) = view("poles")
    points = [mark for mark in poles["marks"] if mark["kind"] == "points"]
    assert max(points[0]["x"]) == pytest.approx(0.9, abs=0.02)
    assert any("Autocorrelation" in plot["title"] for plot in view("correlation"))
    (straight,) = view("curves")
    assert straight["y"]["title"].startswith("Speed")
    rows = client.get("api/about", params={"model": names[0]}).json()["parameters"]
    assert {row["name"] for row in rows} == {"a1", "b1"}
    assert client.post("api/view", json={"view": "other", "models": names}).status_code == 400
    for wrong in ("files/../session.json", "../1/arx", "9/arx"):
        assert client.get("api/about", params={"model": wrong}).status_code == 400
    script = client.post("api/program", json={"models": names, "data": data}).json()["script"]
    named: dict[str, Any] = {}
    exec(script.replace("print(", "found = ("), named)
    assert named["found"].best.row.fit_percent > 99
    assert studio.session.path("other.json", "models").exists()


def test_controllers_compensations_and_designs_are_made_of_a_physical_model(opened: Any, tmp_path: Path) -> None:
    client, studio = opened
    plant = emsid.plants.rigid_motor().with_values({"rotor_friction.coulomb": 2e-3})
    drive = emsid.PlantModel(plant, (emsid.plants.Signal.SPEED,))
    emsid.save(drive, studio.session.path("drive.json", "models"))
    client.post("api/files?name=log.csv", content=table())
    asked = {"model": "files/drive.json", "what": "design", "options": {"limit": "5", "duration": "0.5", "dt": "0.01"}}
    answer = client.post(
        "api/use", json={**asked, "what": "compensate", "options": {"dt": "0.001", "encoder": "2000", "limit": "5"}}
    )
    assert answer.status_code == 200, answer.text
    found = answer.json()
    assert any(name.endswith(".c") for name in found["files"])
    names = zipfile.ZipFile(io.BytesIO(client.get(f"api/use/{found['number']}").content)).namelist()
    assert sorted(names) == sorted(found["files"])
    assert client.post("api/use", json={**asked, "what": "other"}).status_code == 400
    assert client.post("api/use", json={**asked, "options": {"limit": "much"}}).status_code == 400
    assert [path.name for path in (studio.session.folder / "use").iterdir()] == [found["number"]]
    assert client.get("api/use/99").status_code == 400


def test_a_session_keeps_its_token_for_pages_that_are_open(tmp_path: Path) -> None:
    port, token = last_door(tmp_path)
    assert (port, len(token)) == (0, 32)
    private(tmp_path / ".token", f"40000 {token}")
    assert last_door(tmp_path) == (40000, token)
    assert (tmp_path / ".token").stat().st_mode & 0o777 == 0o600
    for wrong in ("", "x", "80 " + token, "40000 short", "40000 a b"):
        (tmp_path / ".token").write_text(wrong)
        assert last_door(tmp_path)[1] not in (token, "short")


# --- hostile sessions and requests ------------------------------------------------------------------------------------


def test_mutated_session_files_are_read_or_refused_in_one_line(tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    with studio_in(tmp_path / "s") as (client, studio):
        client.post("api/files?name=log.csv", content=table(100))
        client.post("api/edit", json={"given": {"units": {"speed": "rpm"}, "rows": [0, 90]}})
        client.post("api/edit", json={"models": ["arx"], "options": {"fixed": {"resistance": "2 ohm"}, "na": 1}})
        path = studio.session.folder / "session.json"
        content = path.read_bytes()
        kinds = [b"[]", b"{}", b"null", b"1e400", b"-1", b'"../x"', b'"\\u0000"', b"[" * 500 + b"]" * 500, b"\xff"]
        read, refused = 0, []
        for k in range(200):
            a, b = sorted(rng.integers(0, len(content), 2))
            if k % 4 == 0:  # a value becomes another
                values = [m.span(1) for m in re.finditer(rb':("[^"]*"|[\d.]+|\[\]|\{\})', content)]
                a, b = values[rng.integers(len(values))]
                mutated = content[:a] + kinds[rng.integers(len(kinds))] + content[b:]
            elif k % 4 == 1:  # a byte becomes another
                mutated = content[:a] + bytes([rng.integers(32, 127)]) + content[a + 1 :]
            else:  # a part is missing, or there twice
                mutated = content[:a] + (content[b:] if k % 4 == 2 else content[a:b] + content[a:])
            path.write_bytes(mutated)
            try:
                studio.session = studio.data.session = Session.at_folder(path.parent)
            except FormatError as problem:
                refused.append(str(problem))
                continue
            read += 1
            answer = client.get("api/state")
            assert answer.status_code == 200, answer.text
            assert "\n" not in answer.json()["problem"]
        assert 20 < read < 180
        assert not any("\n" in problem for problem in refused)


def test_requests_that_would_leave_no_readable_session_are_refused(opened: tuple[TestClient, Studio]) -> None:
    client, studio = opened
    client.post("api/files?name=log.csv", content=table(100))
    deep: Any = 1
    for _ in range(400):
        deep = [deep]
    for content in (
        {"files": ""},
        {"files": {"log.csv": 1}},
        {"files": ["log.csv"], "chosen_for": ["other"]},
        {"given": {"mask": deep}},
        {"given": {"rows": [1, 2, 3, 4, 5]}},
        {"given": [1]},
        {"given": {"units": {"speed": deep}}},
        {"options": {"fixed": 3}},
        {"options": {"na": "9" * 5000}},
        {"unseen": "x"},
        {"unseen": True},
        {"models": [deep]},
    ):
        answer = client.post("api/edit", json=content)
        assert (answer.status_code, "\n" in answer.text) == (400, False), content
    assert len(studio.session.steps) == 2
    assert Session.at_folder(studio.session.folder).step == studio.session.step


def test_an_example_that_comes_too_late_leaves_no_file(
    opened: tuple[TestClient, Studio], monkeypatch: pytest.MonkeyPatch
) -> None:
    client, studio = opened
    arrived = studio.session.arrived

    def edited_meanwhile(name: str) -> None:
        arrived(name)
        studio.session.change(studio.session.version, unseen=0.4)

    monkeypatch.setattr(studio.session, "arrived", edited_meanwhile)
    assert client.post("api/example", json={"name": "motor"}).status_code == 409
    assert [*studio.session.path("").iterdir(), *(studio.session.folder / "incoming").iterdir()] == []


def test_what_was_left_of_a_killed_upload_is_deleted(tmp_path: Path) -> None:
    session = Session.at_folder(tmp_path / "s")
    upload = session.adding("secret.csv")
    name, incoming = upload.__enter__()
    incoming.write_bytes(b"half")
    assert session.free_name(name) == "secret-2.csv"
    again = Session.at_folder(tmp_path / "s")
    assert not incoming.exists()
    assert again.free_name(name) == name


def test_a_session_that_is_killed_while_it_is_written_is_as_before_and_leaves_nothing(tmp_path: Path) -> None:
    Session.at_folder(tmp_path).change(0, unseen=0.4)
    program = """
import os, signal, sys
from pathlib import Path
from emsid.studio.session import Session
session = Session.at_folder(Path(sys.argv[1]))
os.fsync = lambda number: os.kill(os.getpid(), signal.SIGKILL)
session.change(0, unseen=0.5)
"""
    killed = subprocess.run([sys.executable, "-c", program, str(tmp_path)], check=False)
    assert killed.returncode == -signal.SIGKILL
    assert list(tmp_path.glob(".*.tmp"))
    assert Session.at_folder(tmp_path).step["unseen"] == 0.4
    assert {path.name for path in tmp_path.iterdir()} == {"session.json", "data", "models", "runs", "incoming"}


@pytest.mark.parametrize("part", ["summary", "reading"])
def test_a_part_that_fails_costs_that_part_only(
    opened: tuple[TestClient, Studio], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, part: str
) -> None:
    client, studio = opened
    client.post("api/files?name=log.csv", content=table(100))

    def fails(*arguments: Any, **options: Any) -> Any:
        raise ZeroDivisionError("in the test")

    monkeypatch.setattr(studio.data, part, fails)
    with caplog.at_level("DEBUG", "emsid"):
        found = state(client)
    assert "an error inside the program (ZeroDivisionError: in the test)" in found["problem"]
    assert found["step"]["files"] == ["log.csv"]
    assert ("script" in found) == (part == "summary")
    assert any(record.exc_info for record in caplog.records)
    answer = client.post("api/run")
    assert (answer.status_code, "\n" in answer.text) == ((200, False) if part == "summary" else (500, False))


def test_a_record_and_a_part_of_a_result_that_fail_leave_the_others(
    opened: tuple[TestClient, Studio], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    client, studio = opened
    for name in ("a.csv", "b.csv"):
        client.post(f"api/files?name={name}", content=table())
    record = studio.data.record

    def fails(step: dict[str, Any], name: str) -> Record:
        if name == "b.csv":
            raise ZeroDivisionError
        return record(step, name)

    monkeypatch.setattr(studio.data, "record", fails)
    first, second = state(client)["records"]
    assert (first["samples"], second["problem"]) == (400, "b.csv: an error inside the program (ZeroDivisionError)")

    monkeypatch.undo()
    result = emsid.identify(record(studio.session.step, "a.csv"), models=["arx"], na=1, nb=1, nk=1)
    monkeypatch.setattr(worker, "write_files", fails)
    worker.write_result(result, tmp_path, {"reading": {}})
    shown = msgspec.json.decode((tmp_path / "shown.json").read_bytes())
    assert (shown["models"], (tmp_path / "result.json").exists()) == (["arx"], True)
    failed = [each["text"] for each in shown["findings"] if "inside the program" in each["text"]]
    assert len(failed) == 1
