"""Identification: fit several models to records and rank them."""

from emsid.identification.fitting import Elsewhere
from emsid.identification.ranking import FrontRow, Ranked
from emsid.identification.result import Identification, curves
from emsid.identification.workflow import identify
from emsid.models.bands import BandedCurve
from emsid.models.characteristics import Characteristic
from emsid.options import Options
from emsid.selection.improvement import StretchErrors

__all__ = [
    "BandedCurve",
    "Characteristic",
    "Elsewhere",
    "FrontRow",
    "Identification",
    "Options",
    "Ranked",
    "StretchErrors",
    "curves",
    "identify",
]
