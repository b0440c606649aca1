"""TDMS files of LabVIEW, read by npTDMS. A channel of a single group has its own name, else ``group.channel``."""

from __future__ import annotations

from io import BytesIO

from emsid.io.columns import Columns
from emsid.io.packing import Packed, read_by


def read_tdms(content: bytes) -> Columns:
    """The channels of a TDMS file; those with a waveform have a time column.

    Raises:
        FormatError: for content that is no TDMS file, or where npTDMS is not installed.
    """
    return read_by(parsed, content, "a TDMS file", "nptdms", "tdms")


def parsed(content: bytes) -> bytes:
    """The channels, for the process that parses them."""
    from nptdms import TdmsFile

    packed = Packed()
    groups = TdmsFile.read(BytesIO(content)).groups()
    for group in groups:
        for channel in group.channels():
            name = channel.name if len(groups) == 1 else f"{group.name}.{channel.name}"
            time = channel.time_track() if "wf_increment" in channel.properties else None
            unit = str(channel.properties.get("unit_string", ""))
            packed.add(name, channel[:], unit, time, "time" if len(groups) == 1 else f"{group.name}.time")
    return packed.to_bytes()
