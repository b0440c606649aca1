"""Identification: fit several models to records and rank them."""

from emsid.identification.characteristics import Characteristic
from emsid.identification.options import Options
from emsid.identification.result import Identification
from emsid.identification.workflow import identify

__all__ = ["Characteristic", "Identification", "Options", "identify"]
