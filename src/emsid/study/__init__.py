"""The complete study of Kara and Abokoos."""

from emsid.study.models import Settings
from emsid.study.workflow import Study, study

__all__ = ["Settings", "Study", "study"]
