"""`Record`, the one data type of the program, and the time axis that it is read with."""

from emsid.record.channels import ChannelNames
from emsid.record.frequency_response import FrequencyResponse
from emsid.record.holding_back import hold_back
from emsid.record.joining import check_same_channels, concatenate, continuing, segments
from emsid.record.record import FileRows, Record
from emsid.record.time_axis import TimeAxis, time_axis

__all__ = [
    "ChannelNames",
    "FileRows",
    "FrequencyResponse",
    "Record",
    "TimeAxis",
    "check_same_channels",
    "concatenate",
    "continuing",
    "hold_back",
    "segments",
    "time_axis",
]
