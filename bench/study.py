"""The survey of the study with its default settings, kept in the package: ``python bench/study.py``.

It fits every model to a family of motors and to thirty pairs of inputs, searches for the largest ratio that the paper's
own models reach, and fits the motor with its shaft to a record of another integrator (``tests/independent``). It takes
about two minutes.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import asdict
from pathlib import Path

import emsid
from emsid.excitation import sines
from emsid.study.models import IDENTIFICATION, INPUTS, Settings
from emsid.study.survey import RECORDED

HOME = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(HOME / "tests"))
from independent.two_masses import load_speed  # noqa: E402
from survey import survey  # noqa: E402


def rounded(value: object) -> object:
    """Numbers with four digits, at any depth."""
    if isinstance(value, dict):
        return {name: rounded(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(each) for each in value]
    return float(f"{value:.4g}") if isinstance(value, float) else value


if __name__ == "__main__":
    start, settings = time.process_time(), Settings()
    voltage = sines(round(settings.duration / settings.dt), settings.dt, *INPUTS[IDENTIFICATION])
    speed = load_speed(asdict(settings.motor), voltage, settings.dt)
    other = emsid.Record(
        voltage, speed, settings.dt, input_names="voltage", output_names="speed", input_units="V", output_units="rad/s"
    )
    found = survey(settings, others={"integrated by SciPy, smooth friction": other})
    content = json.dumps(rounded(found.to_data()), indent=1, ensure_ascii=False)
    (HOME / "src" / "emsid" / "study" / RECORDED).write_text(f"{content}\n", encoding="utf-8")
    print(f"{RECORDED} written, {time.process_time() - start:.0f} s of processor time")
