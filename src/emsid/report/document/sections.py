"""Reports: their sections, and the tables, terms and notices in them."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace

from emsid.report.document.diagrams import Diagram
from emsid.report.document.plots import Figure


@dataclass(frozen=True)
class Table:
    """A table of text.

    Attributes:
        header: a head for every column.
        rows: as many cells each.
        caption: what it shows.
        note: explanation below the table.
        text_columns: how many columns at the left are text; the others are numbers.
        ends_in_text: whether the last column is text too.
        emphasised: rows in bold.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""
    note: str = ""
    text_columns: int = 1
    ends_in_text: bool = False
    emphasised: frozenset[int] = frozenset()

    def __post_init__(self) -> None:
        if any(len(row) != len(self.header) for row in self.rows):
            raise ValueError(f"table {self.caption!r}: every row needs {len(self.header)} cells")

    def is_text(self, column: int) -> bool:
        """Whether a column is text, counted from 0."""
        return column < self.text_columns or (self.ends_in_text and column == len(self.header) - 1)


@dataclass(frozen=True)
class Term:
    """Definition of a term.

    Attributes:
        word: the term in the tables and figures that follow.
        meaning: in a sentence.
    """

    word: str
    meaning: str


@dataclass(frozen=True)
class Notice:
    """A finding as a sentence.

    Attributes:
        text: the sentence.
        severity: ``info``, ``warning`` or ``problem``.
    """

    text: str
    severity: str = "info"


@dataclass(frozen=True)
class Section:
    """A part of a report, in this order: paragraphs, remarks, terms, equations, diagrams, tables, figures.

    Attributes:
        title: its heading.
        paragraphs: plain text.
        equations: plain text, set in a fixed width.
        tables, figures: what it shows.
        remarks: a list of remarks of one or two sentences each.
        terms: definitions of its terms.
        diagrams: drawings of blocks and lines.
    """

    title: str
    paragraphs: tuple[str, ...] = ()
    equations: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    figures: tuple[Figure, ...] = ()
    remarks: tuple[str, ...] = ()
    terms: tuple[Term, ...] = ()
    diagrams: tuple[Diagram, ...] = ()


@dataclass(frozen=True)
class Fact:
    """A key figure for the first screen.

    Attributes:
        value: with its unit.
        meaning: in a few words.
        interval: of the value, empty where there is none.
    """

    value: str
    meaning: str
    interval: str = ""


@dataclass(frozen=True)
class Report:
    """A report.

    Attributes:
        title: its heading.
        summary: paragraphs of plain text that say what was found.
        sections: its parts.
        facts: key figures of the first screen.
        imprint: a line at the bottom: the command and its data.
        opening: equations, tables and figures of the first screen, before the contents; without a title.
        notices: warnings and problems, beside the opening.
        advice: what to do next, in sentences.
    """

    title: str
    summary: tuple[str, ...]
    sections: tuple[Section, ...]
    facts: tuple[Fact, ...] = ()
    imprint: str = ""
    opening: Section = Section("")
    notices: tuple[Notice, ...] = ()
    advice: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        drawn: list[Figure | Diagram] = [*self.figures, *self.diagrams]
        names = [each.name for each in drawn]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice:
            raise ValueError(f"two figures are called {twice!r}; their files need names of their own")

    @property
    def figures(self) -> Iterator[Figure]:
        """All figures of all sections, in order."""
        return (figure for section in (self.opening, *self.sections) for figure in section.figures)

    @property
    def diagrams(self) -> Iterator[Diagram]:
        """All diagrams of all sections, in order."""
        return (diagram for section in (self.opening, *self.sections) for diagram in section.diagrams)

    def with_figures(self, names: Collection[str]) -> Report:
        """The same with only the figures of these names."""

        def kept(section: Section) -> Section:
            return replace(section, figures=tuple(each for each in section.figures if each.name in names))

        return replace(self, opening=kept(self.opening), sections=tuple(map(kept, self.sections)))
