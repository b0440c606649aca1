"""Files: records as tables, MAT, Parquet, NPZ; motors and datasheets as TOML; models as JSON.

Only this package opens files.
"""

from emsid.io.files import atomic_write
from emsid.io.frequency_table import read_frequency_response, write_frequency_response
from emsid.io.model_file import Origin, load, load_model, origin, read_options, save
from emsid.io.motor_file import datasheet_template, motor_template, read_datasheet, read_motor
from emsid.io.other_files import file_and_column
from emsid.io.reading import READERS, ParsedFile, read, read_columns
from emsid.io.record_file import WRITERS, write_record

__all__ = [
    "READERS",
    "WRITERS",
    "Origin",
    "ParsedFile",
    "atomic_write",
    "datasheet_template",
    "file_and_column",
    "load",
    "load_model",
    "motor_template",
    "origin",
    "read",
    "read_columns",
    "read_datasheet",
    "read_frequency_response",
    "read_motor",
    "read_options",
    "save",
    "write_frequency_response",
    "write_record",
]
