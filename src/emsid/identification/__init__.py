"""From records to a ranked list of models."""

from emsid.identification.candidates import Options
from emsid.identification.key_figures import KeyFigure
from emsid.identification.result import Identification
from emsid.identification.workflow import identify

__all__ = ["Identification", "KeyFigure", "Options", "identify"]
