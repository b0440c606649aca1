"""The models: every model is a value that can be simulated, used to predict, printed and saved."""

from emsid.models.kinds import KINDS
from emsid.models.model import Model

# The kind in a model file, and the class that reads it.
MODELS: dict[str, type[Model]] = {each.kind: each.model for each in KINDS}
