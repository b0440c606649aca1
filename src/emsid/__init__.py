"""Identification of electromechanical systems: from a record of voltage and speed to a model you can trust.

The names listed in ``__init__.pyi`` are the library; each is imported when it is first used, so that ``import emsid``
and ``emsid --help`` load neither compiler nor plotting library.
"""

from functools import partial
from importlib import import_module

import lazy_loader

from emsid.presentation import analyse_with, present_with
from emsid.renamed import with_old_names

__version__ = "0.1.0"

_present, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
RENAMED = {
    "GreyBox": "PlantModel",
    "DrivenMotor": "MotorPlant",
    "Narx": "RegressionModel",
    "assess": "validate",
    "assess_model": "validate",
}
"""The present name for every old one."""
__getattr__ = with_old_names(__name__, _present, RENAMED)

present_with(partial(import_module, "emsid.report.notebook"))
analyse_with(partial(import_module, "emsid.validation.analysis"))
