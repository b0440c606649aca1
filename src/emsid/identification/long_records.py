"""Long records: models are compared with fits to an excerpt, and the recommended one is then fitted to all samples."""

from __future__ import annotations

from collections.abc import Sequence

from emsid.findings import Finding
from emsid.identification.compared import Compared
from emsid.record import Record
from emsid.record.excerpt import excerpt, outside_excerpt

COMPARED, PIECES, MOST_PIECES = 24_000, 3, 8
"""The samples and pieces of the excerpt that several models are fitted to. Of several experiments one piece each,
as long as these, and at most eight pieces. From n samples the mean square error of a model with p parameters and white
noise is larger by the share p/n, so more would not change which model is best. A piece is as long as the stretch that
filters of a cascade are compared on; shorter ones led some to other minima."""


def to_compare(train: Record, names: Sequence[str]) -> tuple[Record, Record | None]:
    """The data to fit these models to: an excerpt of a long record, if there are several models to compare.

    Args:
        train: the data to fit.
        names: of the models.

    Returns:
        These data, and those outside the excerpt; None where all data are fitted.
    """
    if len(names) == 1:
        return train, None
    pieces = min(max(PIECES, len(train.segments)), MOST_PIECES)
    size = COMPARED * pieces // PIECES, pieces
    return excerpt(train, *size), outside_excerpt(train, *size)


def about_excerpt(judged: Compared, train: Record) -> list[Finding]:
    """The findings about the data that models were compared on.

    Args:
        judged: the models.
        train: all data to fit.
    """
    if judged.record is train:
        return []
    model = "" if judged.whole is None else judged.best.model.name
    data = {"samples": len(judged.record), "of": len(train), "finished": model}
    return [Finding("fitted-to-excerpt", train.name, data)]
