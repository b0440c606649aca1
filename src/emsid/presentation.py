"""`Presented`: base class of results that print as a table, draw themselves in a notebook, and can be plotted.

`emsid.report.notebook` makes the table and the plot of each kind of result. It is imported inside these three methods,
so that the report is loaded only when a result is shown. No other import in the package points from left to right.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Presented:
    """A result that prints as a table, draws itself in a notebook, and can be plotted."""

    def __str__(self) -> str:
        from emsid.report.notebook import text

        return text(self)

    def _repr_html_(self) -> str:
        from emsid.report.notebook import html

        return html(self)

    def plot(self) -> Figure:
        """A Matplotlib figure, to be shown, changed, or saved with ``savefig("figure.svg")``.

        A record is drawn with its inputs and outputs; a comparison with the measured outputs and the free run of every
        model; an identification with its comparison on unseen data; a fit of a plant with the free run on the data it
        was fitted to, any other fit with the width of the interval of every parameter.
        """
        from emsid.report.notebook import plot

        return plot(self)
