"""From records to a ranked list of models."""

from emsid.identification.result import Identification
from emsid.identification.workflow import identify

__all__ = ["Identification", "identify"]
