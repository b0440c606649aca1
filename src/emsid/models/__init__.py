"""What can be identified; every model predicts, simulates, prints itself, and is a value."""

from emsid.models.model import Model
from emsid.models.narx import Narx

# The name that a model file carries, and the class that reads it.
MODELS: dict[str, type[Model]] = {"narx": Narx}
