"""Export of a model for other programs, as an archive of the files that `emsid.export` writes."""

from __future__ import annotations

import io
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path

from starlette.responses import Response

import emsid
from emsid.errors import DataError
from emsid.exports import FORMATS
from emsid.io import origin
from emsid.models.verbs import as_model
from emsid.studio.play import loaded


def formats() -> list[str]:
    """The formats of `emsid.export`."""
    return sorted(FORMATS)


def exported(path: Path, format: str, assume: Sequence[str] = ()) -> Response:
    """A model in a format, as an archive.

    Args:
        path: the model file.
        format: its name.
        assume: parameters whose values nobody gave or measured and that may be written.

    Raises:
        DataError: for an unknown format.
        EmsidError: where the model cannot be exported like this.
    """
    if format not in FORMATS:
        raise DataError(f"there is no format {format}; there are {', '.join(FORMATS)}")
    found, source, content = loaded(path), origin(path), io.BytesIO()
    dt = source.dt if source is not None and as_model(found).dt is None else None
    with tempfile.TemporaryDirectory() as folder:
        emsid.export(found, format, folder, dt=dt, force=True, assume=tuple(assume))
        with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
            for file in sorted(Path(folder).rglob("*")):
                if file.is_file():
                    archive.write(file, file.relative_to(folder))
    headers = {"content-disposition": f'attachment; filename="{path.stem}-{format}.zip"'}
    return Response(content.getvalue(), media_type="application/zip", headers=headers)
