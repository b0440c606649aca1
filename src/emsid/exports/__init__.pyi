from .formats import FORMATS as FORMATS
from .formats import Export as Export
from .formats import Format as Format
from .verb import export as export
