"""Fleets: the same model fitted to many motors over many periods, on the processors of this machine or of a cluster."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
