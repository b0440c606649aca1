"""Export of a model for other programs, as far as this installation has `emsid.export`."""

from __future__ import annotations

import io
import tempfile
import zipfile
from importlib import import_module
from pathlib import Path
from typing import Any

from starlette.responses import Response

import emsid
from emsid.errors import DataError
from emsid.studio.play import loaded


def formats() -> list[str]:
    """The formats of `emsid.export`; none where there is no export."""
    try:
        found = import_module("emsid.export")
    except ImportError:
        return []
    return sorted(found.FORMATS)


def exported(path: Path, format: str) -> Response:
    """A model in a format, as an archive of the files that the export writes.

    Raises:
        DataError: for an unknown format.
        EmsidError: where the model cannot be exported like this.
    """
    if format not in formats():
        raise DataError(f"there is no format {format}; there are {', '.join(formats()) or 'none here'}")
    export: Any = getattr(emsid, "export")  # noqa: B009 - it may not exist here
    content = io.BytesIO()
    with tempfile.TemporaryDirectory() as folder:
        export(loaded(path), format, Path(folder) / path.stem)
        with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
            for each in sorted(Path(folder).rglob("*")):
                if each.is_file():
                    archive.write(each, each.relative_to(folder))
    headers = {"content-disposition": f'attachment; filename="{path.stem}-{format}.zip"'}
    return Response(content.getvalue(), media_type="application/zip", headers=headers)
