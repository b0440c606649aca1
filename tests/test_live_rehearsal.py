"""Tracking compiles its kernels before it opens a source."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from emsid import PlantModel, plants, save
from emsid.cli.commands import track
from emsid.models.plants.parameters import Signal

TRACKED = """
import gc, sys
from dataclasses import replace
from pathlib import Path
from numba.core.dispatcher import Dispatcher
from emsid import RecursiveLeastSquares, load
from emsid.cli.commands.track import structure_of
from emsid.estimation import Directional
from emsid.live.rehearsal import rehearse
from emsid.live.session import Settings
from emsid.live.tracking import Tracker
from live_sessions import lines, tracked

def compiled():
    functions = [each for each in gc.get_objects() if isinstance(each, Dispatcher)]
    return {f"{f.py_func.__module__}.{f.py_func.__name__}{types}" for f in functions for types in f.signatures}

folder = Path(sys.argv[1])
tracker = Tracker(RecursiveLeastSquares(structure_of("friction-narx", {}, None), rule=Directional(0.99)))
tracker = replace(tracker, model=load(folder / "motor.json"))
rehearse(tracker, 1, detects=True)
before = compiled()
settings = Settings(every=0.01, patience=5.0, false_alarm=10.0)
session, _ = tracked(lines(4000, step=3500, dt=0.01), folder=folder, settings=settings, tracker=tracker)
assert session.changes and session.physical and before
print(*sorted(compiled() - before), sep="\\n")
"""


def test_a_session_calls_no_kernel_that_its_rehearsal_did_not(tmp_path: Path) -> None:
    save(PlantModel(plants.rigid_motor(), (Signal.SPEED,)), tmp_path / "motor.json")
    words = [sys.executable, "-c", TRACKED, str(tmp_path)]
    here = Path(__file__).parent
    done = subprocess.run(words, capture_output=True, text=True, cwd=here, timeout=300, check=False)
    assert (done.returncode, done.stdout.strip()) == (0, ""), done.stderr


def test_kernels_are_compiled_before_a_connection_is_opened(
    tmp_path: Path, run: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A connection that cannot be opened is refused after it, a file that is not there before."""
    done: list[bool] = []
    monkeypatch.setattr(track, "_compile", lambda *_: done.append(True))
    assert run("track", tmp_path / "none.csv", "--out", tmp_path / "o")[0] == 2
    assert not done
    assert run("track", "socket://localhost:1", "--patience", "0.01", "--out", tmp_path / "o")[0] == 2
    assert done
