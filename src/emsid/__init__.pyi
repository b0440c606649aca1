from .errors import DataError as DataError
from .errors import EmsidError as EmsidError
from .errors import FormatError as FormatError
from .errors import ModelError as ModelError
from .estimation.fit import Ending as Ending
from .estimation.fit import Fit as Fit
from .estimation.information import Information as Information
from .estimation.least_squares import least_squares as least_squares
from .estimation.least_squares import solve_rows as solve_rows
from .estimation.recursive import RecursiveLeastSquares as RecursiveLeastSquares
from .estimation.recursive import recursive_least_squares as recursive_least_squares
from .models.model import Model as Model
from .models.model import Run as Run
from .models.narx import Narx as Narx
from .models.regressors import Structure as Structure
from .models.regressors import arx as arx
from .models.regressors import friction_narx as friction_narx
from .models.regressors import wiener_hammerstein_regression as wiener_hammerstein_regression
from .record import Record as Record
from .record import concatenate as concatenate
from .validation.comparison import Comparison as Comparison
from .validation.comparison import assess as assess
from .validation.comparison import compare as compare

__version__: str
