"""Exports: a model as C, for a simulator, a firmware or a table; see `export`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
