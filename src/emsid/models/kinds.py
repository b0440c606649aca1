"""The kinds of models, by the names of their model files; a further kind is a line here.

`capabilities_of` says what a model can do, so that no other part of the program asks for its type.
"""

from __future__ import annotations

from typing import Any

from emsid.models.blocks.capabilities import OfCascades
from emsid.models.capabilities import Capabilities, Estimator
from emsid.models.feedback.capabilities import OfFeedbackModels
from emsid.models.linear.capabilities import OfPolynomials, OfProcesses, OfStateSpaces, OfTransferFunctions
from emsid.models.model import Model
from emsid.models.plants.capabilities import OfPlants
from emsid.models.regression.capabilities import OfRegressions

KINDS: tuple[Capabilities[Any], ...] = (
    OfRegressions(),
    OfStateSpaces(),
    OfPolynomials(),
    OfProcesses(),
    OfTransferFunctions(),
    OfCascades(),
    OfFeedbackModels(),
    OfPlants(),
)
MODELS: dict[str, type[Model]] = {kind.kind: kind.model for kind in KINDS}
"""The classes of the models by the names in their files."""
ESTIMATORS: dict[type, Estimator] = {what: how for kind in KINDS for what, how in kind.estimators.items()}
"""How `emsid.fit` fits what makes a model, by its type; a plant is known by what it has, see `emsid.models.verbs`."""
OF_RESPONSES: dict[type, Estimator] = {what: how for kind in KINDS for what, how in kind.of_responses.items()}
"""How it fits them to measured frequency responses; plants are known by what they have."""
_BY_CLASS = {kind.model: kind for kind in KINDS}
_UNKNOWN: Capabilities[Any] = Capabilities()


def capabilities_of(model: Any) -> Capabilities[Any]:
    """What a model can do; of a kind that is not registered, nothing but run."""
    return next((_BY_CLASS[kind] for kind in type(model).__mro__ if kind in _BY_CLASS), _UNKNOWN)
