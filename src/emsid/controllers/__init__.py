"""Controllers: cascades of current, speed and position loops for an identified plant, with margins over its region."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
