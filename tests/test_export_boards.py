"""Models as a library for boards: compiled for AVR and Cortex-M, run in their simulators, and the sketch here."""

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import emsid
from model_examples import DT, cascades, feedback, plants, regressions, state_spaces

HERE = Path(__file__).parent
BOARDS = HERE / "boards"
MODELS: dict[str, Any] = {
    name: model for kind in (regressions, state_spaces, cascades, feedback, plants) for name, model in kind()
}
WARNINGS = ["-std=gnu99", "-Wall", "-Wextra", "-Werror"]
AVR = ["avr-gcc", "-mmcu=atmega2560", "-Os", *WARNINGS]
CORTEX = ["arm-none-eabi-gcc", "-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", "-O2", *WARNINGS]
CORTEX += ["-nostartfiles", "-T", str(BOARDS / "cortex.ld"), "--specs=rdimon.specs"]
RUN_AVR = ["simavr", "-m", "atmega2560", "-f", "16000000"]
RUN_CORTEX = ["qemu-system-arm", "-M", "mps2-an386", "-nographic", "-monitor", "none", "-serial", "none", "-icount"]
RUN_CORTEX += ["shift=0", "-semihosting-config", "enable=on,target=native", "-kernel"]
TOOLS = {"avr": (AVR, RUN_AVR), "cortex": (CORTEX, RUN_CORTEX)}
CHOSEN = ("friction", "feedback, tanh", "rigid motor")


def commands() -> np.ndarray:
    """(1000, 1) what the program of the board gives to the model."""
    number, found = 1, []
    for k in range(1000):
        number = (number * 1664525 + 1013904223) % 2**32 if k % 10 == 0 else number
        found.append(((number >> 16) % 2001 - 1000) / 250)
    return np.array(found)[:, None]


def on_board(model: Any, board: str, folder: Path) -> tuple[np.ndarray, int]:
    """The outputs (1000,) of a model on a simulated board, and its cycles for a step; on Cortex-M instructions."""
    compiler, simulator = TOOLS[board]
    for tool in (compiler[0], simulator[0]):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed")
    emsid.export(model, "arduino", folder, name="model", dt=None if model.dt else DT)
    source, program = folder / "src", folder / "program.elf"
    files = [str(BOARDS / "main.c"), str(source / "model.c")]
    subprocess.run([*compiler, f"-I{source}", *files, "-lm", "-o", program], check=True)
    done = subprocess.run([*simulator, program], capture_output=True, text=True, check=True, timeout=60)
    text = re.sub(r"\x1b\[\d*m", "", done.stdout + done.stderr)
    bits = np.array([int(each, 16) for each in re.findall(r"^([0-9a-f]{8})\b", text, re.MULTILINE)], dtype=np.uint32)
    cycles = re.search(r"cycles (\d+)", text)
    assert cycles is not None
    return bits.view(np.float32).astype(float), int(cycles[1])


@pytest.mark.parametrize("board", TOOLS)
@pytest.mark.parametrize("name", CHOSEN)
def test_a_board_gives_the_numbers_of_the_model(name: str, board: str, tmp_path: Path) -> None:
    model = MODELS[name]
    found, cycles = on_board(model, board, tmp_path)
    truth = model.run(model.at_rest(0.0, model.dt or DT), commands())[0][:, 0]
    assert np.abs(found - truth).max() < 1e-5 * truth.std()
    assert 0 < cycles < 100_000  # 160 steps a second at 16 MHz


def test_the_library_has_what_its_managers_read(tmp_path: Path) -> None:
    emsid.export(MODELS["arx"], "arduino", tmp_path, name="plant")
    properties = dict(line.split("=", 1) for line in (tmp_path / "library.properties").read_text().splitlines())
    assert {"name", "version", "author", "maintainer", "sentence", "paragraph", "category", "url", "architectures"} <= (
        set(properties)
    )
    assert properties["includes"] == "plant.h"
    described = json.loads((tmp_path / "library.json").read_text())
    assert described["version"] == properties["version"] == "1.0.0"
    assert sorted(path.name for path in (tmp_path / "src").iterdir()) == ["plant.c", "plant.h"]


@pytest.mark.skipif(shutil.which("g++") is None, reason="g++ is not installed")
def test_the_sketch_runs_the_model(tmp_path: Path) -> None:
    """On the clock of a board: the answer to a step of a second."""
    emsid.export(MODELS["arx"], "arduino", tmp_path, name="plant")
    sketch, source = tmp_path / "examples/plant_run/plant_run.ino", tmp_path / "src"
    subprocess.run(["gcc", "-O2", "-c", source / "plant.c", "-o", tmp_path / "plant.o"], check=True)
    words = ["g++", "-std=c++17", f"-I{source}", f"-I{HERE / 'arduino'}", f'-DSKETCH="{sketch}"']
    program = tmp_path / "program"
    subprocess.run([*words, HERE / "arduino" / "run.cpp", tmp_path / "plant.o", "-lm", "-o", program], check=True)
    text = subprocess.run([program, "0", "2500000", ""], capture_output=True, text=True, check=True).stdout
    found = np.array([float(line) for line in text.split()])
    dt = MODELS["arx"].dt
    u = ((np.arange(1, len(found) + 1) * dt).astype(int) % 2).astype(float)
    truth = emsid.simulate(MODELS["arx"], u, dt=dt).output[:, 0]
    assert len(found) == pytest.approx(2.5 / dt, abs=2)
    late = np.abs(np.diff(u)).nonzero()[0]  # a step may come a sample later on the clock of the board
    near = np.abs(np.arange(len(u))[:, None] - late).min(axis=1) > 60
    assert np.abs(found - truth)[near].max() < 1e-3 * np.abs(truth).max()


def test_tables_in_ram_are_said(tmp_path: Path) -> None:
    emsid.export(dict(cascades())["wiener-hammerstein, spline"], "arduino", tmp_path, name="plant")
    assert "tables of this model in RAM" in (tmp_path / "README.md").read_text("utf-8")
