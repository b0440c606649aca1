"""A model as a library for Arduino and PlatformIO: the C of `emsid.exports.c99` in single precision, and a sketch.

The folder goes into ``libraries`` of the Arduino IDE or ``lib`` of a PlatformIO project as it is. Boards of 8 bits have
no double precision, and few others have it in hardware, so there is no choice.
"""

from __future__ import annotations

import json
from dataclasses import replace

from emsid.exports.c99 import c99
from emsid.exports.formats import Export, Files

VERSION = "1.0.0"
"""Of the library; both formats demand one."""


def arduino(export: Export) -> tuple[Files, list[str]]:
    """The library.

    Raises:
        ModelError: for a model without a form in C, or a sample time that is missing.
    """
    sources, notes = c99(replace(export, options={"single": True}))
    name = export.name
    what = f"{export.model.name}, identified by emsid"
    properties = {
        "name": name,
        "version": VERSION,
        "author": "emsid",
        "maintainer": "emsid",
        "sentence": f"The model {what}.",
        "paragraph": f"{name}_step takes the inputs of a sample of {export.dt!r} s and gives the outputs.",
        "category": "Device Control",
        "url": "",
        "architectures": "*",
        "includes": f"{name}.h",
    }
    described = {
        "name": name,
        "version": VERSION,
        "description": what,
        "headers": f"{name}.h",
        "frameworks": "*",
        "platforms": "*",
    }
    files: Files = {
        "library.properties": "".join(f"{key}={' '.join(text.split())}\n" for key, text in properties.items()),
        "library.json": json.dumps(described, indent=2) + "\n",
        **{f"src/{file}": text for file, text in sources.items()},
        f"examples/{name}_run/{name}_run.ino": sketch(name, export.dt or 0.0),
    }
    if "static const real" in str(sources[f"{name}.c"]):
        notes.append("Boards of 8 bits keep the tables of this model in RAM.")
    return files, notes


def sketch(name: str, dt: float) -> str:
    """An example: the answer to a step every second, printed."""
    upper = name.upper()
    return f"""\
// Made by emsid: the answer of the model to a step that comes and goes every second.
#include <Arduino.h>
#include <{name}.h>

static {name}_state state;
static const unsigned long PERIOD = {max(round(dt * 1e6), 1)}UL;  // us
static unsigned long due;

void setup() {{
  Serial.begin(115200);
  {name}_init(&state);
  due = micros();
}}

void loop() {{
  {name}_real u[{upper}_INPUTS];
  {name}_real y[{upper}_OUTPUTS];
  if (micros() - due < PERIOD) return;
  due += PERIOD;
  for (int k = 0; k < {upper}_INPUTS; ++k) u[k] = millis() / 1000UL % 2UL ? 1.0f : 0.0f;
  {name}_step(&state, u, y);
  Serial.println(y[0], 6);
}}
"""
