"""The models: every model is a value that can be simulated, used to predict, printed and saved."""

from emsid.models.blocks.cascade import Cascade
from emsid.models.feedback.model import FeedbackModel
from emsid.models.linear.polynomials import PolynomialModel
from emsid.models.linear.process_model import ProcessModel
from emsid.models.linear.state_space import StateSpaceModel
from emsid.models.model import Model
from emsid.models.plants.grey_box import GreyBox
from emsid.models.regression.narx import Narx

# The kind in a model file, and the class that reads it.
MODELS: dict[str, type[Model]] = {
    "narx": Narx,
    "state-space": StateSpaceModel,
    "polynomials": PolynomialModel,
    "process": ProcessModel,
    "cascade": Cascade,
    "feedback": FeedbackModel,
    "grey-box": GreyBox,
}
