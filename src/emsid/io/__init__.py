"""Files: records from tables, MAT, Parquet and NPZ; motors from TOML; models as JSON. Nothing else opens a
file."""

from emsid.io.files import atomic_write
from emsid.io.reading import READERS, read, read_columns

__all__ = ["READERS", "atomic_write", "read", "read_columns"]
