"""Long records: models are compared with fits to an excerpt, and the recommended one is then fitted to all samples."""

from __future__ import annotations

from collections.abc import Sequence

from emsid.errors import EmsidError
from emsid.estimation.nonlinear.control import FREE, Control, Stopped
from emsid.findings import Finding
from emsid.identification.candidates import CANDIDATES
from emsid.identification.compared import Compared
from emsid.identification.options import Continued, Options
from emsid.identification.ranking import ranked
from emsid.models.refitting import is_safe
from emsid.record import Record
from emsid.record.excerpt import excerpt, outside_excerpt
from emsid.selection.improvement import better
from emsid.validation.comparison import compare

COMPARED, PIECES, MOST = 24_000, 3, 8
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
    pieces = min(max(PIECES, len(train.segments)), MOST)
    size = COMPARED * pieces // PIECES, pieces
    return excerpt(train, *size), outside_excerpt(train, *size)


def on_all_samples(judged: Compared, train: Record, options: Options, control: Control = FREE) -> Compared:
    """The comparison with the recommended model fitted to the whole record, from its estimates of the excerpt.

    The model of the excerpt is kept where there is no time, for a kind of model that cannot be continued, and where it
    is better by more than noise on the unseen data that chose.

    Args:
        judged: the models, fitted to an excerpt.
        train: all data to fit.
        options: how they were fitted.
        control: when to stop.
    """
    fit, choice = judged.best, judged.chosen_on
    kind = CANDIDATES.get(fit.model.name)
    if not isinstance(kind, Continued):
        return judged
    doing = f"fitting {fit.model.name} to all samples"
    try:
        control.doing(doing)
        found = kind.continued(fit, train, options, control.during(doing))
        control.check()
        errors = {id(each.fit): each.errors for each in ranked(compare([fit, found], choice), None, options)}
        safe = is_safe(found.model, choice, fit.model)
    except (EmsidError, Stopped):
        return judged
    worse = better(errors[id(fit)], than=errors[id(found)])
    return judged.with_finished(found, train) if safe and not worse else judged


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
