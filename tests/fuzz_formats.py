"""Mutate files of measuring systems and robots and read them; a program of its own, so that its memory can be limited.

The parsers run in this process, which is faster than a process for each file; so a crash of a library ends it. Prints
every mutation that ends in anything but columns or an `EmsidError` in one line, or takes too long, and at last how many
were tried.

Usage: fuzz_formats.py KIND MUTATIONS SEED
"""

import random
import resource
import sys
import tempfile
from pathlib import Path
from time import process_time
from unittest import mock

from emsid.errors import EmsidError, FormatError
from emsid.io import read_columns
from test_io_more_formats import bag, excel, feather, mcap, mcap_of_ros, mdf, tdms, wpilog

MEMORY, SLOW = 6 << 30, 2.0
KINDS = {
    "arrow": (".feather", feather),
    "excel": (".xlsx", excel),
    "tdms": (".tdms", tdms),
    "mdf": (".mf4", mdf),
    "wpilog": (".wpilog", wpilog),
    "mcap": (".mcap", mcap),
    "ros": (".mcap", mcap_of_ros),
    "bag": (".bag", lambda: bag(Path(tempfile.mkdtemp()))),
}
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


def in_this_process(parser, content, damaged):
    """As `emsid.io.sandbox.in_sandbox`, without its process."""
    try:
        return parser(content)
    except BaseException:
        raise FormatError(damaged) from None


def fuzz(kind, count, seed, folder):
    """Mutations that were read, that were refused, and what went wrong."""
    suffix, make = KINDS[kind]
    rng, content, path = random.Random(seed), make(), Path(folder) / f"file{suffix}"
    read, refused, wrong = 0, 0, []
    with (
        mock.patch("emsid.io.packing.in_sandbox", in_this_process),
        mock.patch("emsid.io.arrow.in_sandbox", in_this_process),
    ):
        for k in range(count):
            path.write_bytes(mutated(content, rng))
            begun = process_time()
            try:
                read_columns(path)
                read += 1
            except EmsidError as problem:
                refused += 1
                if not str(problem).startswith(f"{path}: ") or len(str(problem).splitlines()) > 1:
                    wrong.append((k, str(problem)))
            except Exception as problem:
                wrong.append((k, repr(problem)))
            if process_time() - begun > SLOW:
                wrong.append((k, f"{process_time() - begun:.1f} s"))
    return read, refused, wrong


if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    with tempfile.TemporaryDirectory() as folder:
        read, refused, wrong = fuzz(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), folder)
    for each in wrong:
        print(*each)
    print(f"{sys.argv[1]}: {read} read, {refused} refused, {len(wrong)} wrong")
