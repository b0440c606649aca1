"""Pages that are made from the program, before Sphinx looks for its pages. They are not part of the repository."""

from sphinx.application import Sphinx


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    return {"parallel_read_safe": True}
