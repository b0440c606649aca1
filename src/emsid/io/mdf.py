"""MDF files (versions 3 and 4) of measurement systems in vehicles, read by asammdf. Every channel has its own times."""

from __future__ import annotations

from collections import Counter
from io import BytesIO

from emsid.io.sandbox import Packed, read_by


def parsed(content: bytes) -> bytes:
    """The channels, for the process that parses them."""
    from asammdf import MDF

    packed = Packed()
    with MDF(BytesIO(content)) as file:
        signals = list(file.iter_channels())
    names = Counter(signal.name for signal in signals)
    for signal in signals:
        name = signal.name if names[signal.name] == 1 else f"{signal.group_index}.{signal.name}"
        packed.add(name, signal.samples, signal.unit or "", signal.timestamps)
    return packed.to_bytes()


read_mdf = read_by(parsed, "an MDF file", "asammdf", "mdf")
"""The channels of an MDF file, with the time column of their group."""
