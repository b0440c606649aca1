"""The mask that leaves out samples which are no measurements: codes, missing values and outliers."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from emsid.findings import Finding
from emsid.first_look.columns import Column
from emsid.first_look.outliers import limit_of_ordinary, outliers_of


def mask_of(columns: Sequence[Column], output: Column | None) -> str | None:
    """The condition that leaves out codes, missing values where there are many, and outliers of the output.

    Args:
        columns: that are used.
        output: one of them.
    """
    conditions = []
    for column in columns:
        name = in_expression(column)
        if column.gaps:
            conditions.append(f"isnan({name})")
        if not column.codes:
            continue
        limit = max(abs(column.low), abs(column.high))
        if all(abs(code.value) > limit for code in column.codes):
            conditions.append(f"abs({name}) > {limit:g}")
        else:
            values = ", ".join(f"{code.value:g}" for code in column.codes)
            conditions.append(f"{name} IN ({values})")
    if output is not None:
        conditions += [finding.data["mask"] for finding in masked_outliers(output)]
    return " OR ".join(conditions) or None


def masked_outliers(output: Column) -> Iterable[Finding]:
    """A finding on the outliers of an output if a limit leaves out these and nothing else."""
    limit = None if output.period or output.kind != "numbers" else limit_of_ordinary(output.signal)
    if limit is not None:
        found, away = outliers_of(output.signal)
        mask = f"abs({in_expression(output)}) > {limit:g}"
        numbers = {"count": len(found), "sample": int(found[0]), "size": float(away.max()), "confidence": 0.8}
        yield Finding("outliers", output.name, numbers | {"mask": mask})


def in_expression(column: Column) -> str:
    """The name of a column as a mask has it."""
    return column.name if re.fullmatch(r"[A-Za-z_]\w*", column.name) else f'"{column.name}"'
