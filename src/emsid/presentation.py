"""`Presented`: base class of results that print as a table, draw themselves in a notebook, and can be plotted.

Results know nothing of the report that shows them. The package names it when it is imported (`present_with`), and it is
loaded when a result is shown.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Presenter(Protocol):
    """What shows results."""

    def text(self, thing: object, /) -> str:
        """A result as a table of text."""

    def html(self, thing: object, /) -> str:
        """A result as HTML for a notebook."""

    def plot(self, thing: object, /) -> Figure:
        """A result as a Matplotlib figure."""


_presenter: Callable[[], Presenter]


def present_with(presenter: Callable[[], Presenter]) -> None:
    """Let all results be shown by what ``presenter`` gives. It is called when the first of them is shown."""
    global _presenter
    _presenter = presenter


_analysis: Callable[[], Any]


def analyse_with(module: Callable[[], Any]) -> None:
    """Let fits be analysed by the functions of what ``module`` gives. It is called when the first of them is needed."""
    global _analysis
    _analysis = module


def analysis() -> Any:
    """The module with the functions that analyse a fit."""
    return _analysis()


class Presented:
    """A result that prints as a table, draws itself in a notebook, and can be plotted."""

    def __str__(self) -> str:
        return _presenter().text(self)

    def _repr_html_(self) -> str:
        return _presenter().html(self)

    def plot(self) -> Figure:
        """A Matplotlib figure, to be shown, changed, or saved with ``savefig("figure.svg")``.

        A record is drawn with its inputs and outputs; a comparison with the measured outputs and the free run of every
        model; an identification with its comparison on unseen data; a fit of a plant with the free run on the data it
        was fitted to, its friction and its dead zone, any other fit with the width of the interval of every parameter.
        """
        return _presenter().plot(self)
