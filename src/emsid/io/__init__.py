"""Files: records from tables, MAT, Parquet and NPZ; motors from TOML; models as JSON. Nothing else opens a file."""

from emsid.io.files import atomic_write
from emsid.io.model_file import load, save
from emsid.io.motor_file import read_motor
from emsid.io.reading import READERS, read, read_columns
from emsid.io.record_file import WRITERS, write_record

__all__ = [
    "READERS",
    "WRITERS",
    "atomic_write",
    "load",
    "read",
    "read_columns",
    "read_motor",
    "save",
    "write_record",
]
