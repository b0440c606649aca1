"""uPlot, the library that draws the plots of the page: not part of the source, fetched once with npm and verified.

The build of a wheel fetches it (``hatch_build.py`` executes this file, so it imports the standard library only), and so
does the installation of a clone. Where npm was missing then, this does it later:

    python -m emsid.studio.uplot

The page loads it from the studio only, never from a network.
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

VERSION = "1.6.32"
SHA512 = "KIMVnG68zvu5XXUbC4LQEPnhwOxBuLyW1AHtpm6IKTXImkbLgkMy+jabjLgSLMasNuGGzQm/ep3tOkyTxpiQIw=="
FILES = {"uPlot.esm.js": "dist/uPlot.esm.js", "uPlot.min.css": "dist/uPlot.min.css", "LICENSE": "LICENSE"}
"""The files of the page, and where they are in the package."""
PLACE = Path(__file__).parent / "page" / "vendor"


class NotFetched(Exception):
    """Raised where uPlot cannot be had."""


def is_there() -> bool:
    """Whether the files of uPlot are where the page looks for them."""
    return all((PLACE / name).is_file() for name in FILES)


def unpack(package: bytes) -> None:
    """Check a package of npm and put the files of uPlot into their place.

    Raises:
        NotFetched: where it is not the package of this version.
    """
    found = b64encode(hashlib.sha512(package).digest()).decode()
    if found != SHA512:
        raise NotFetched(f"the package of uPlot {VERSION} has another checksum ({found}); nothing was installed")
    with tarfile.open(fileobj=io.BytesIO(package)) as archive:
        PLACE.mkdir(exist_ok=True)
        for name, member in FILES.items():
            content = archive.extractfile(f"package/{member}")
            assert content is not None  # the checksum is right
            part = PLACE / f"{name}.part"
            part.write_bytes(content.read())
            part.replace(PLACE / name)


def fetch() -> None:
    """Get uPlot with npm.

    Raises:
        NotFetched: where npm is missing or fails, or gives another package.
    """
    with tempfile.TemporaryDirectory() as folder:
        try:
            program = ["npm", "pack", f"uplot@{VERSION}", "-s"]
            subprocess.run(program, cwd=folder, check=True, capture_output=True, timeout=120)
        except (OSError, subprocess.SubprocessError) as problem:
            raise NotFetched(f"npm cannot fetch uPlot {VERSION} ({problem}); install npm and repeat") from None
        unpack((Path(folder) / f"uplot-{VERSION}.tgz").read_bytes())


def main() -> None:
    """Get uPlot unless it is there; an error is one line on standard error, and exit status 2."""
    try:
        if not is_there():
            fetch()
    except NotFetched as problem:
        sys.stderr.write(f"emsid: {problem}\n")
        sys.exit(2)
    sys.stdout.write(f"uPlot {VERSION} is in {PLACE}\n")


if __name__ == "__main__":
    main()
