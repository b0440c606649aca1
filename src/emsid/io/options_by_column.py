"""Arguments of `emsid.read` that are given by column: which columns they may name."""

from __future__ import annotations

from collections.abc import Mapping

from emsid.errors import DataError
from emsid.findings import Finding
from emsid.io.columns import Columns, nearest
from emsid.units import column_of


def surplus_units(units: Mapping[str, str], sources: Mapping[str, str], columns: Columns) -> dict[str, Finding]:
    """Units of columns of the file that are no channels, with a finding for each; they may be of another command.

    Args:
        units: by column.
        sources: the column of each channel.
        columns: of the file.
    """
    channels = list(sources)
    known = {*channels, *sources.values()}
    return {
        name: Finding("unit-not-used", name, {"unit": unit, "channels": channels})
        for name, unit in units.items()
        if name not in known and column_of(name, columns.series) in columns.series
    }


def check_options(options: Mapping[str, Mapping[str, object]], sources: Mapping[str, str]) -> None:
    """Refuse an option for a column that is not a channel: the name is misspelt.

    Args:
        options: by name, its values by column.
        sources: the column of each channel; that of a derivative has another name.

    Raises:
        DataError: that names the column, and the nearest one.
    """
    known = dict.fromkeys(sources.values())
    for option, by_column in options.items():
        allowed = (
            [*known, *(name for name, column in sources.items() if name != column)] if option == "units" else [*known]
        )
        for name in by_column:
            if name not in allowed:
                raise DataError(
                    f"{option} is given for {name!r}, which is neither input nor output{nearest(name, allowed)}; "
                    f"these are {', '.join(allowed)}"
                )
