"""Conversion of the channels of a record to other units."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from emsid.record.argument_types import UNITS, typed
from emsid.units import SI, si_unit

OfRecord = TypeVar("OfRecord", bound=Any)


class UnitMethods:
    """`convert` and `in_si` of a record."""

    @typed(units=UNITS)
    def convert(self: OfRecord, units: Mapping[str, str | None] | None = None, **scales: float) -> OfRecord:
        """Convert every channel with a unit to SI, or the named channels to the given units.

        Args:
            units: the new unit of each channel to convert, None for SI; without this argument all become SI.
            scales: the scales of counts and PWM, see `emsid.units.conversion`: ``counts_per_revolution``,
                ``supply_voltage``, ``pwm_full_scale``.
        """
        from emsid.units import conversion

        present = dict(zip(self.input_names + self.output_names, self.input_units + self.output_units, strict=True))
        wanted = {name: None for name, unit in present.items() if unit} if units is None else dict(units)
        result = self
        for given, target in wanted.items():
            name = self._own_name(given)
            gain, offset, unit = conversion(present[name], target, sample_time=self.dt, **scales)
            result = result.scale(name, gain, offset, unit)
        return result

    def in_si(self: OfRecord, **scales: float) -> OfRecord:
        """The record with every channel in SI whose unit can be converted; the record itself where all are.

        Counts and PWM of unknown size, and units that are not understood, remain. `emsid.fit`, `emsid.identify`,
        `emsid.simulate` and the functions that judge a fit convert their records in this way.

        Args:
            scales: as in `convert`.
        """
        sizes = {"sample_time": self.dt, **scales}
        units = dict(zip(self.input_names + self.output_names, self.input_units + self.output_units, strict=True))
        other = [name for name, unit in units.items() if unit and unit not in SI and si_unit(unit, **sizes)]
        result: OfRecord = self.convert(dict.fromkeys(other), **scales) if other else self
        return result
