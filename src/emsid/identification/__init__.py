"""From records to a ranked list of models."""

from emsid.identification.workflow import Identification, identify

__all__ = ["Identification", "identify"]
