from .bench import Bench as Bench
from .bench import Run as Run
from .cascade import Cascade as Cascade
from .cascade import Settings as Settings
from .loops import Margins as Margins
from .verb import Controller as Controller
from .verb import control as control
