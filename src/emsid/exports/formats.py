"""What a format of an export is: a function in a file of its own, and a line in `emsid.exports.registry.FORMATS`.

It takes an `Export` and returns the contents of its files by name. It raises `ModelError` for a model that it
cannot carry, with what is missing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from emsid.errors import ModelError
from emsid.estimation.fit import Fit
from emsid.models.model import Model
from emsid.record import Record

Files = dict[str, str | bytes]
"""The contents of files by their names; text is written as UTF-8."""


@dataclass(frozen=True, eq=False)
class Export:
    """What is exported.

    Attributes:
        model: the model.
        fit: its table of parameters; None for a model alone.
        name: of files and functions.
        dt: sample time in s.
        options: of the format, by name.
        record: data with signals of the usual size; None without any.
    """

    model: Model
    fit: Fit[Any] | None
    name: str
    dt: float | None
    options: Mapping[str, Any] = field(default_factory=dict)
    record: Record | None = None

    def sampled(self) -> tuple[Export, float]:
        """The same with a sample time, by default that of the data of the fit, and this in s.

        Raises:
            ModelError: where none is known.
        """
        step = self.fit.sample_time if self.dt is None and self.fit is not None else self.dt
        if step is None:
            raise ModelError(f"{self.model.name} has no sample time of its own; give dt", arguments=("dt",))
        return replace(self, dt=step), step


SWITCH = {"yes": True, "true": True, "1": True, "no": False, "false": False, "0": False}
"""What switches an option on or off."""


def switched(export: Export, name: str) -> bool:
    """Whether an option is on; one that is not given is off.

    Raises:
        ModelError: for another value than yes or no.
    """
    value = str(export.options.get(name, "no")).lower()
    if value not in SWITCH:
        raise ModelError(f"{name} is {value!r}; give yes or no", arguments=("option",))
    return SWITCH[value]


class Format(NamedTuple):
    """A format.

    Attributes:
        summary: what it is, in a few words.
        function: makes its files, and the sentences on what it cannot carry.
        options: the options that it has.
        physical: whether its files have values of physical parameters, which hang on what was assumed; the others carry
            the behaviour from input to output only, which does not.
    """

    summary: str
    function: Callable[[Export], tuple[Files, list[str]]]
    options: tuple[str, ...] = ()
    physical: bool = False
