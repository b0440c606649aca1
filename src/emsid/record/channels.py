"""The channels of a record without its data: what a model was fitted to, so that its outputs have names and units."""

from __future__ import annotations

from dataclasses import dataclass

from emsid.record.record import Record


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

    @classmethod
    def of(cls, record: Record) -> ChannelNames:
        """The channels of a record."""
        return cls(
            record.dt,
            tuple(zip(record.input_names, record.input_units, strict=True)),
            tuple(zip(record.output_names, record.output_units, strict=True)),
        )
