"""Equations as MathML, which browsers draw without a script, a font from elsewhere or a network.

Docutils translates LaTeX to MathML; an equation that it cannot translate is a warning, and so an error of the build.
"""

from __future__ import annotations

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.writers.html5 import HTML5Translator

log = logging.getLogger(__name__)


def translated(text: str, node: nodes.Node, block: bool) -> str:
    """An equation in MathML."""
    try:
        return tex2mathml(text, as_block=block)
    except MathError as problem:
        log.warning("equation: %s", problem, location=node)
        return ""


def inline(writer: HTML5Translator, node: nodes.math) -> None:
    """Write an equation within a line."""
    writer.body.append(translated(node.astext(), node, False))
    raise nodes.SkipNode


def display(writer: HTML5Translator, node: nodes.math_block) -> None:
    """Write an equation on a line of its own."""
    writer.body.append(f'<div class="equation">{translated(node.astext(), node, True)}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.add_html_math_renderer("mathml", (inline, None), (display, None))
    return {"parallel_read_safe": True}
