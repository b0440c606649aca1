from .merged import least_squares_over as least_squares_over
from .merged import merged as merged
from .spread import Change as Change
from .spread import Outlier as Outlier
from .verb import Fleet as Fleet
from .verb import fleet as fleet
from .work import Row as Row
