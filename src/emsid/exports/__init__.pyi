from .formats import Export as Export
from .formats import Format as Format
from .registry import FORMATS as FORMATS
from .verb import export as export
