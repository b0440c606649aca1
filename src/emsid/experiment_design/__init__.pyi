from .verb import Design as Design
from .verb import Prediction as Prediction
from .verb import design as design
