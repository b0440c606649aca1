"""A first look at a file: its columns, guesses of input, output and time, and the quality of the data."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
