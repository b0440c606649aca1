"""The types of the arguments of `emsid.io.read`."""

from __future__ import annotations

from collections.abc import Mapping

from emsid.record.argument_types import (
    CONDITION,
    NAME,
    NAMES,
    NUMBER,
    NUMBERS,
    SLICE,
    SWITCH,
    TEXT,
    TEXTS,
    WHOLE,
    Kind,
    check_types,
)

__all__ = ["KINDS", "check_types"]

KINDS: Mapping[str, Kind] = {
    **dict.fromkeys(("input", "output"), NAMES),
    "time": NAME,
    "time_unit": TEXT,
    "mask": CONDITION,
    **dict.fromkeys(("dt", "counts_per_revolution", "supply_voltage", "pwm_full_scale", "filter"), NUMBER),
    **dict.fromkeys(("resample", "skip_bad_rows"), SWITCH),
    **dict.fromkeys(("derivative_window", "decimate", "detrend"), WHOLE),
    **dict.fromkeys(("wrap", "shift", "scale", "offset"), NUMBERS),
    **dict.fromkeys(("direction", "units"), TEXTS),
    "rows": SLICE,
}
"""The types of the arguments of `read`."""
