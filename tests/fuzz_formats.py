"""Cut and mutate files of measuring systems and robots and read them; a program of its own, so that memory is limited.

The parsers run in this process, which is faster than a process for each file; where one crashes, which the sandbox of
the reader keeps from its user, another process goes on with the next file. Prints
every mutation that ends in anything but columns or an `EmsidError` in one line, or takes too long or too much memory,
and at last how many were tried.

Usage: fuzz_formats.py KIND MUTATIONS SEED
"""

import os
import random
import resource
import signal
import sys
import tempfile
from ast import literal_eval
from contextlib import ExitStack
from multiprocessing import get_context
from pathlib import Path
from time import process_time
from unittest import mock

import numpy as np
import polars as pl

from emsid.errors import EmsidError, FormatError
from emsid.io import read_columns
from test_io_formats import parquet
from test_io_more_formats import bag, dataflash, excel, feather, mcap, mcap_of_ros, mdf, tdms, ulog, wpilog

ADDRESSES, MEMORY = 6 << 30, 1 << 30
"""Bytes that a parser may ask for, and that it may use."""
SLOW, HANGS, CUTS = 2.0, 10, 10
"""Seconds of a processor that are too many for a small file, seconds after which it is given up; cuts of each file."""
KINDS = {
    "parquet": (
        ".parquet",
        lambda: parquet(pl.DataFrame({"t": K / 10, "u": K, "y": K**2, "v": [[1.0, k] for k in K]})),
    ),
    "arrow": (".feather", feather),
    "excel": (".xlsx", excel),
    "tdms": (".tdms", tdms),
    "mdf": (".mf4", mdf),
    "wpilog": (".wpilog", wpilog),
    "mcap": (".mcap", mcap),
    "ros": (".mcap", mcap_of_ros),
    "ulog": (".ulg", ulog),
    "dataflash": (".bin", dataflash),
    "bag": (".bag", lambda: bag(Path(tempfile.mkdtemp()))),
}
K = np.arange(30.0)
WORDS = [b"\xff\xff\xff\x7f", b"\0\0\0\x80", b"\xff\xff\xff\xff", b"\0\0\0\0", b"\0\0\1\0"]


def mutated(content, rng):
    """A file with bytes or whole numbers changed, a piece missing or twice, or its end cut off."""
    changed = bytearray(content)
    for _ in range(rng.choice([1, 1, 2, 4, 8])):
        at, kind = rng.randrange(len(changed)), rng.random()
        if kind < 0.5:
            changed[at] = rng.randrange(256)
        elif kind < 0.7:
            changed[at : at + 4] = rng.choice(WORDS)
        elif kind < 0.8:
            del changed[at : at + rng.randrange(1, 40)]
        elif kind < 0.9:
            changed[at:at] = changed[at : at + rng.randrange(1, 60)]
        else:
            del changed[max(at, 1) :]
        changed = changed or bytearray(b"x")
    return bytes(changed)


class Hangs(BaseException):
    """A parser that does not end, or takes too much."""


def give_up(*_):
    raise Hangs


def damaged_files(content, count, rng):
    """The file cut at `CUTS` places, then mutations."""
    yield from (content[: len(content) * k // (CUTS + 1)] for k in range(1, CUTS + 1))
    yield from (mutated(content, rng) for _ in range(count))


def in_this_process(parser, content, damaged):
    """As `emsid.io.sandbox.in_sandbox`, without its process."""
    try:
        return parser(content)
    except Hangs:
        raise
    except BaseException:
        raise FormatError(damaged) from None


def fuzz(kind, count, seed, folder, first=0):
    """Damaged files from the first that were read, that were refused, and what went wrong."""
    suffix, make = KINDS[kind]
    rng, content, path = random.Random(seed), make(), Path(folder) / f"file{suffix}"
    read, refused, wrong = 0, 0, []
    before = signal.signal(signal.SIGALRM, give_up)
    with ExitStack() as patched:
        for module in ("sandbox", "parquet"):
            patched.enter_context(mock.patch(f"emsid.io.{module}.in_sandbox", in_this_process))
        for k, damaged in enumerate(damaged_files(content, count, rng)):
            if k < first:
                continue
            path.write_bytes(damaged)
            (Path(folder) / "number").write_text(f"{k} {read} {refused} {wrong}")
            begun, used = process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            signal.alarm(HANGS)
            try:
                read_columns(path)
                read += 1
            except EmsidError as problem:
                refused += 1
                if not str(problem).startswith(f"{path}: ") or len(str(problem).splitlines()) > 1:
                    wrong.append((k, str(problem)))
            except (Exception, Hangs) as problem:
                wrong.append((k, repr(problem)))
            finally:
                signal.alarm(0)
            if process_time() - begun > SLOW:
                wrong.append((k, f"{process_time() - begun:.1f} s"))
            more = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - used) << 10
            if more > MEMORY:
                wrong.append((k, f"{more >> 20} MiB"))
    signal.signal(signal.SIGALRM, before)
    return read, refused, wrong


def main(kind, count, seed):
    """Fuzz in processes: as many as there are crashes, and one."""
    read = refused = crashed = first = 0
    wrong = []
    context = get_context("spawn")
    with tempfile.TemporaryDirectory() as folder:
        while True:
            process = context.Process(target=in_a_process, args=(kind, count, seed, folder, first))
            process.start()
            process.join()
            number, more_read, more_refused, more = (Path(folder) / "number").read_text().split(" ", 3)
            read, refused, wrong = read + int(more_read), refused + int(more_refused), [*wrong, *literal_eval(more)]
            if process.exitcode == 0:
                break
            crashed, first = crashed + 1, int(number) + 1
            if crashed > count // 4:
                wrong.append((first, "too many crashes"))
                break
    for each in wrong:
        print(*each)
    print(f"{kind}: {read} read, {refused} refused, {crashed} crashed, {len(wrong)} wrong")


def in_a_process(kind, count, seed, folder, first):
    """A process of `main`."""
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
    with open(os.devnull, "wb") as nothing:
        os.dup2(nothing.fileno(), 1)  # libraries print what they find
        os.dup2(nothing.fileno(), 2)
    read, refused, wrong = fuzz(kind, count, seed, folder, first)
    (Path(folder) / "number").write_text(f"{count} {read} {refused} {wrong}")


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
