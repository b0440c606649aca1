"""The next experiment: a test signal within limits that determines the wanted parameters best."""

from emsid.experiment_design.verb import Design as Design
from emsid.experiment_design.verb import Prediction as Prediction
from emsid.experiment_design.verb import design as design
