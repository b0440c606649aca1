"""From records to a ranked list of models."""

from emsid.identification.candidates import Options
from emsid.identification.characteristics import Characteristic
from emsid.identification.result import Identification
from emsid.identification.workflow import identify

__all__ = ["Characteristic", "Identification", "Options", "identify"]
