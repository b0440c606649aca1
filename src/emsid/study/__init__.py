"""The study of Kara and Abokoos, end to end."""

from emsid.study.workflow import Settings, Study, study

__all__ = ["Settings", "Study", "study"]
