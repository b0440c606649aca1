"""Errors of models on unseen data, and tests of their residuals."""

import lazy_loader

from emsid.renamed import with_old_names

_present, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = with_old_names(__name__, _present, {"assess": "validate", "assess_model": "validate"})
