"""Mutate model files, then load, run, analyse and export what comes out.

A program of its own, so that its memory can be limited. Prints a line of JSON for every mutation that ends in anything
but a model or an `EmsidError` of one line, warns, or takes too long, and at last how many were tried.

Usage: fuzz_model_files.py MUTATIONS SEED
"""

import json
import random
import resource
import sys
import tempfile
import warnings
from copy import deepcopy
from pathlib import Path
from time import perf_counter

import msgspec
import numpy as np

import emsid
from emsid.errors import EmsidError
from emsid.exports.registry import FORMATS
from emsid.io import load, origin, save
from emsid.io.model_file import _checksum, _Document
from emsid.record import Record

GOLDEN = Path(__file__).parent / "golden" / "models"
MEMORY = 2**30
SLOW, MOST_SECONDS = 10.0, 60.0
NASTY = [
    *(0, 1, -1, 2, 7, 63, 300, 3_000, 10_000, 10**6, 10**9, 2**31, 2**63, -(2**63), 2**64, 10**30, 10**400),
    *(0.5, -0.5, 1e-300, 1e-12, 1e3, 1e50, 1e99, 1e300, -1e300, 1e308, -0.0),
    *(None, True, False, "", "x", "[/red]", "y(t-1)", "y(t-99999999999)", "u999999999(t)", "u(t)^9", "\u202e"),
    "1" * 500,
    *("y(t-1)*" * 40 + "y(t-1)", "max(u(t-1)-1e400, 0)", "abs(" * 200, "speed", "position", "motor", "dead-zone"),
    *([], [0], [1, [2, [3]]], {}, {"kind": "filter"}, {"a": {"b": {}}}, [1e308] * 3, [0.0] * 90, [1.0] * 3_000),
]  # fmt: skip


NUMBERS = [0.0, 1.0, -1.0, 0.999999999, 1.0000001, 1e-99, 1e-12, -1e3, 1e6, 1e12, 1e30, -1e50, 1e99]


def places(value, path=()):
    """Every path into nested tables and lists."""
    yield path
    children = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in children:
        yield from places(inner, (*path, key))


def mutated(model, rng):
    """The data of a model with one to three entries replaced, taken out, doubled or moved."""
    model = deepcopy(model)
    for _ in range(rng.randint(1, 3)):
        path = rng.choice([place for place in places(model) if place])
        parent = model
        for key in path[:-1]:
            parent = parent[key]
        kind, key = rng.choice(["replace"] * 6 + ["delete", "repeat", "scale"]), path[-1]
        if isinstance(parent[key], float) and rng.random() < 0.7:
            parent[key] = rng.choice([*NUMBERS, 10 * parent[key], -parent[key], 1e-6 * parent[key]])
            continue
        if kind == "delete":
            del parent[key]
        elif kind == "repeat" and isinstance(parent[key], list):
            parent[key] = parent[key] * rng.choice([2, 3, 50])
        elif kind == "scale" and isinstance(parent[key], float):
            parent[key] *= rng.choice([-1.0, 0.0, 1e-9, 1e9, 1e99])
        else:
            parent[key] = deepcopy(rng.choice(NASTY))
        if not model:
            break
    return model


def spoiled(content, rng):
    """The bytes of a file with some changed, cut off, or with an entry that is there twice or of another version."""
    kind = rng.randrange(4)
    if kind == 0:
        return content[: rng.randrange(len(content))]
    if kind == 1:
        changed = bytearray(content)
        for _ in range(rng.randint(1, 5)):
            changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
        return bytes(changed)
    if kind == 2:
        return content.replace(b"{", b"{" + rng.choice([b'"model": 1,', b'"schema": 99,', b'"type": "arx",']), 1)
    return content.replace(b'"model":', b'"model":' + rng.choice([b"[", b'{"a":']) * rng.choice([30, 100_000]), 1)


def attempt(path, record, format):
    """Load, run, analyse and export a model: what was raised or warned of that should not be, and how long it took."""
    begin, problem = perf_counter(), ""
    try:
        origin(path)
        model = load(path)
        works = [
            lambda: str(model) + model.equation(),
            lambda: save(model, path.with_name("again.json")),
            lambda: model.simulate(record),
            lambda: emsid.compare([model], record),
            lambda: emsid.step(model, dt=record.dt),
            lambda: emsid.bode(model, dt=record.dt),
            lambda: emsid.poles(model),
            lambda: emsid.export(model, format, path.with_name("exported"), dt=record.dt, force=True),
        ]
    except EmsidError as refused:
        return "\n" in str(refused) and str(refused), perf_counter() - begin
    except BaseException as failure:
        return f"{type(failure).__name__}: {failure}"[:200], perf_counter() - begin
    for work in works:
        try:
            work()
        except EmsidError as refused:
            problem = problem or ("\n" in str(refused) and str(refused))
        except BaseException as failure:
            problem = f"{type(failure).__name__}: {failure}"[:200]
    return problem, perf_counter() - begin


def main(mutations, seed):
    rng = random.Random(seed)
    warnings.simplefilter("error")
    files = [json.loads(path.read_text()) for path in sorted(GOLDEN.glob("*-[0-9].json"))]
    u = np.repeat(np.random.default_rng(0).uniform(-6, 6, 20), 10)
    records = [
        Record(u, np.cumsum(u) * 0.01, 0.01, ("u",), ("y",), (unit,), (out,))
        for unit, out in (("V", "rad/s"), ("N", "m"))
    ]
    path = Path(tempfile.mkdtemp()) / "model.json"
    for file in files:  # compiles what is compiled before time and memory count
        path.write_text(json.dumps(file))
        load(path).simulate(records["axis" in json.dumps(file)])
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    begin, tried = perf_counter(), 0
    while tried < mutations and perf_counter() - begin < MOST_SECONDS:
        whole = rng.choice(files)
        document = _Document("emsid model", rng.choice([1, 2]), whole["type"], mutated(whole["model"], rng), "")
        try:
            document.sha256 = _checksum(document)
            content = msgspec.json.encode(document)
            path.write_bytes(spoiled(content, rng) if rng.random() < 0.15 else content)
        except (OverflowError, ValueError, TypeError):  # integers that msgspec cannot write
            data = json.dumps({"format": "emsid model", "schema": 2, "type": whole["type"], "model": document.model})
            path.write_text(data[:-1] + ', "sha256": ""}')
        tried += 1
        record = records[whole["type"] == "grey-box" and "axis" in json.dumps(whole["model"])]
        format = rng.choice(list(FORMATS))
        problem, seconds = attempt(path, record, format)
        if seconds > SLOW:  # the first run of a kernel compiles it
            problem, seconds = attempt(path, record, format)
        if problem or seconds > SLOW:
            print(json.dumps({"problem": problem, "seconds": seconds, "file": path.read_text()[:3000]}))
    print(tried)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
