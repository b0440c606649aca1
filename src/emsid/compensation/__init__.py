"""Compensation: the inverses of what a model knows, to be put before the plant."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
