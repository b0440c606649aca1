"""Maps of other families in place of those of a fitted model, each begun at the map that it replaces."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

from emsid.errors import EmsidError
from emsid.models.blocks.search.map_families import family_of
from emsid.models.feedback.search.further_maps import Maps, usual_size
from emsid.models.feedback.search.starts import with_family
from emsid.models.feedback.search.trials import Bench, FeedbackSearch, Trial


def other_families(bench: Bench, best: Trial, settings: FeedbackSearch, families: Maps) -> Iterator[Trial]:
    """With maps of other families, or more knots or a higher degree of the given one."""
    others = [(family_of(name), size) for name, size in families]
    if settings.static is not None:
        now = usual_size(settings.static, settings.size)
        larger = [size for size in settings.static.sizes if size > now]
        others = [] if settings.size or settings.static.smooth else [(settings.static, size) for size in larger[:1]]
    for family, size in others:
        if (family, size) == (best.family, best.size):
            continue
        bench.control.doing(f"map: {family.name}")
        with suppress(EmsidError):
            start, states = with_family(best.found, bench.shown, family, usual_size(family, size))
            yield bench.refined(start, states, family, size)
