"""What can be identified; every model predicts, simulates, prints itself, and is a value."""

from emsid.models.blocks.cascade import Cascade
from emsid.models.model import Model
from emsid.models.plants.grey_box import GreyBox
from emsid.models.regression.narx import Narx

# The name that a model file carries, and the class that reads it.
MODELS: dict[str, type[Model]] = {"narx": Narx, "cascade": Cascade, "grey-box": GreyBox}
