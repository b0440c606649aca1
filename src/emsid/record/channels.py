"""The channels of a record without its data: what a model was fitted to, so that its outputs have names and units."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

from emsid.errors import DataError
from emsid.record.frequency_response import FrequencyResponse
from emsid.record.record import Record
from emsid.units import channel_and_unit, in_unit


@dataclass(frozen=True)
class ChannelNames:
    """Name and unit of every channel of a record, and its sample time.

    Attributes:
        dt: sample time in s.
        inputs, outputs: (name, unit) of every channel.
    """

    dt: float
    inputs: tuple[tuple[str, str], ...]
    outputs: tuple[tuple[str, str], ...]

    @property
    def inputs_in_units(self) -> list[str]:
        """The inputs as ``voltage [V]``."""
        return [in_unit(*channel) for channel in self.inputs]

    @property
    def outputs_in_units(self) -> list[str]:
        """The outputs likewise."""
        return [in_unit(*channel) for channel in self.outputs]

    @classmethod
    def of(cls, record: Record | FrequencyResponse) -> ChannelNames:
        """The channels of a record, or of a frequency response; of one without a sample time, that of its band."""
        own = record.dt
        if isinstance(record, FrequencyResponse):
            own = own or 0.5 / float(record.frequency[-1])
        return cls(
            own or 0.0,
            tuple(zip(record.input_names, record.input_units, strict=True)),
            tuple(zip(record.output_names, record.output_units, strict=True)),
        )

    def in_these_units(self, record: Record) -> Record:
        """A record in the units of these channels, by position; channels of another quantity remain in SI.

        Args:
            record: its channels may have other names.
        """
        record = record.in_si()
        for side in ("input", "output"):
            names, wanted = getattr(record, f"{side}_names"), getattr(self, f"{side}s")
            units = getattr(record, f"{side}_units")
            for name, unit, channel in zip(names, units, wanted, strict=False):
                target = channel_and_unit(*channel)[1]
                if unit and target not in ("", unit):
                    with suppress(DataError):
                        record = record.convert({name: target})
        return record
