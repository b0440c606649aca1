"""uPlot, the library that draws the plots of the page: not part of the source, fetched once with npm and verified.

    python -m emsid.studio.uplot

A wheel that was built after this contains it. The page loads it from the studio only, never from a network.
"""

from __future__ import annotations

import hashlib
import io
import subprocess
import sys
import tarfile
import tempfile
from base64 import b64encode
from pathlib import Path

from emsid.errors import FormatError
from emsid.io import atomic_write

VERSION = "1.6.32"
SHA512 = "KIMVnG68zvu5XXUbC4LQEPnhwOxBuLyW1AHtpm6IKTXImkbLgkMy+jabjLgSLMasNuGGzQm/ep3tOkyTxpiQIw=="
FILES = ("uPlot.esm.js", "uPlot.min.css")
PLACE = Path(__file__).parent / "page" / "vendor"


def is_there() -> bool:
    """Whether the files of uPlot are where the page looks for them."""
    return all((PLACE / name).is_file() for name in FILES)


def unpack(package: bytes) -> None:
    """Check a package of npm and put the files of uPlot into their place.

    Raises:
        FormatError: where it is not the package of this version.
    """
    found = b64encode(hashlib.sha512(package).digest()).decode()
    if found != SHA512:
        raise FormatError(f"the package of uPlot {VERSION} has another checksum ({found}); nothing was installed")
    with tarfile.open(fileobj=io.BytesIO(package)) as archive:
        for name in FILES:
            member = archive.extractfile(f"package/dist/{name}")
            if member is None:
                raise FormatError(f"the package of uPlot {VERSION} has no {name}")
            atomic_write(PLACE / name, member.read())


def fetch() -> None:
    """Get uPlot with npm.

    Raises:
        FormatError: where npm is missing or fails, or gives another package.
    """
    with tempfile.TemporaryDirectory() as folder:
        try:
            program = ["npm", "pack", f"uplot@{VERSION}", "-s"]
            subprocess.run(program, cwd=folder, check=True, capture_output=True, timeout=120)
        except (OSError, subprocess.SubprocessError) as problem:
            raise FormatError(f"npm cannot fetch uPlot {VERSION} ({problem}); install npm and repeat") from None
        unpack((Path(folder) / f"uplot-{VERSION}.tgz").read_bytes())


def main() -> None:
    """Get uPlot unless it is there; an error is one line on standard error, and exit status 2."""
    try:
        if not is_there():
            fetch()
    except FormatError as problem:
        sys.stderr.write(f"emsid: {problem}\n")
        sys.exit(2)
    sys.stdout.write(f"uPlot {VERSION} is in {PLACE}\n")


if __name__ == "__main__":
    main()
