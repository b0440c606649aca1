"""The next experiment: a test signal within limits that determines the wanted parameters best."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
