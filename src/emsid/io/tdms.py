"""TDMS files of LabVIEW, read by npTDMS. A channel of a single group has its own name, else ``group.channel``."""

from __future__ import annotations

from collections.abc import Mapping
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.io.sandbox import Packed, read_by


def parsed(content: bytes) -> bytes:
    """The channels, for the process that parses them."""
    from nptdms import TdmsFile

    packed = Packed()
    file = TdmsFile.read(BytesIO(content))
    groups, known = file.groups(), file.file_status.channel_statuses or {}
    for group in groups:
        for channel in group.channels():
            name = channel.name if len(groups) == 1 else f"{group.name}.{channel.name}"
            time = _times(len(channel), channel.properties)
            unit = str(channel.properties.get("unit_string", ""))
            if channel.path in known and known[channel.path].read_length < known[channel.path].expected_length:
                missing = known[channel.path].expected_length - known[channel.path].read_length
                packed.cut[name] = (len(channel), len(channel) + missing)  # the statuses are of the last segment
            packed.add(name, channel[:], unit, time, "time" if len(groups) == 1 else f"{group.name}.time")
    return packed.to_bytes()


def _times(samples: int, properties: Mapping[str, Any]) -> NDArray[np.float64] | None:
    """The times of a waveform in s; None for another channel. npTDMS has them only where a start is given too."""
    step = float(properties.get("wf_increment", 0.0))
    start = float(properties.get("wf_start_offset", 0.0))
    return start + step * np.arange(samples, dtype=np.float64) if step > 0 else None


read_tdms = read_by(parsed, "a TDMS file", "nptdms", "tdms")
"""The channels of a TDMS file; those with a waveform have a time column."""
