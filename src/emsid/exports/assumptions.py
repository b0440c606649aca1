"""What a model assumes: values that nobody gave or measured, and who may write them into a file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from emsid.errors import ModelError, listed
from emsid.estimation.estimates import Estimate, Status
from emsid.estimation.fit import Fit
from emsid.units import with_unit


def assumed(fit: Fit[Any] | None) -> tuple[Estimate, ...]:
    """The values of a fit that nobody gave or measured: those on which estimates depend, and others with an effect.

    Of a model without the table of a fit, the sources of its values are not known, so that none is assumed.
    """
    if fit is None:
        return ()
    needed = {row.name for row in fit.assumed}
    invented = (Status.KEPT, Status.BUILT_IN, Status.UNDETERMINED)
    return tuple(
        row
        for row in fit.table
        if row.name in needed or (row.status in invented and row.value != 0 and row.datasheet is None)
    )


def sentences(fit: Fit[Any] | None) -> list[str]:
    """A sentence for every assumed value, with the estimates that depend on it."""
    found = []
    for row in assumed(fit):
        names = [] if fit is None else [each.name for each in fit.table if row.name in each.given]
        depend = f"; {listed(names)} depend{'s' * (len(names) == 1)} on it" if names else ""
        found.append(f"{row.name} {with_unit(f'{row.value:.4g}', row.unit)} is assumed, not measured{depend}.")
    return found


def refuse_assumed(fit: Fit[Any] | None, format: str, assume: Sequence[str]) -> None:
    """Refuse to write physical values that are assumed, unless each of them is named.

    Args:
        fit: what is exported; None for a model alone.
        format: its name, for the message.
        assume: the parameters, by name or symbol, whose values may be assumed.

    Raises:
        ModelError: for an assumed value that is not named, or a name that the fit does not have.
    """
    if fit is None:
        return
    known = {name for row in fit.table for name in (row.name, row.symbol, row.symbol.partition("_")[0]) if name}
    unknown = [name for name in assume if name not in known]
    if unknown:
        raise ModelError(f"{fit.model_name} has no parameter {unknown[0]!r} to assume", arguments=("assume",))
    left = [row for row in assumed(fit) if not {row.name, row.symbol, row.symbol.partition("_")[0]} & {*assume}]
    if left:
        values = listed([f"{row.name} {with_unit(f'{row.value:.4g}', row.unit)}" for row in left])
        are, them = ("are", "them") if len(left) > 1 else ("is", "it")
        raise ModelError(
            f"{format} carries physical values, and {values} {are} assumed, not measured; identify again with {them} "
            f"given, or let {them} be assumed: {','.join(row.name for row in left)}",
            arguments=("assume",),
        )
