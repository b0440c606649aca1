"""What an identification is asked for: data divided into what is fitted and what is unseen, models, and how to fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from emsid.errors import DataError, ModelError
from emsid.estimation.linear.least_squares import check_sizes
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.findings import Finding
from emsid.first_look.data_advice import questions
from emsid.first_look.examined import Response, response_of
from emsid.first_look.faults import without_faults
from emsid.first_look.stops import without_stops
from emsid.identification.candidates import lift_an_arm, usual_for, with_unit_of_name
from emsid.identification.delay import with_delay
from emsid.identification.long_records import to_compare
from emsid.identification.records import Records, as_one, given_records
from emsid.identification.requests import check_physics, codes_of_channel, plants_of, understood, unused_requests
from emsid.identification.unstable import ORDER, about_the_loop, unstable_pole
from emsid.models.plants.grey_box import assumptions
from emsid.models.plants.plant import Plant
from emsid.options import Options
from emsid.record import Record
from emsid.record.holding_back import FAIR, hold_back_records, shares

FEWEST, FEWEST_FITTED = 20, 10
"""With fewer samples nothing is left to test a model on after it is fitted, and too little to fit it to."""


@dataclass(frozen=True, eq=False)
class Task:
    """What an identification is asked for.

    Attributes:
        records: the given records.
        others: the records that were given as unseen data; empty where a part of `records` is kept unseen.
        record: all of `records`, joined.
        to_fit: the data that are not unseen.
        train: what the models are fitted to; of a long record an excerpt of `to_fit`.
        outside: the data of `to_fit` outside the excerpt; None where all of them are fitted.
        unseen: the data that no model is fitted to.
        names: of the models.
        plants: those of them that are physical, by name.
        asked: the options as they were given.
        options: the same with what the data say about a delay, and codes as values of the channel.
        transient: samples that start a free run where a segment begins in motion.
        responses: of the outputs of `records`, as far as a first look shows them.
        about_delay: what was found about the delay.
        pole: of a plant that is unstable without its controller, see `unstable_pole`; else None.
    """

    records: tuple[Record, ...]
    others: tuple[Record, ...]
    record: Record
    to_fit: Record
    train: Record
    outside: Record | None
    unseen: Record
    names: tuple[str, ...]
    plants: Mapping[str, Plant]
    asked: Options
    options: Options
    transient: int | None
    responses: tuple[Response | None, ...]
    about_delay: tuple[Finding, ...]
    pole: float | None = None

    @classmethod
    def of(
        cls,
        records: Records,
        unseen: Records | float,
        names: tuple[str, ...] | None,
        options: Options,
        transient: int | None,
        reading: Mapping[str, Any],
        control: Control = FREE,
    ) -> Task:
        """The task of `identify`, from its arguments.

        Raises:
            ModelError: for options that no model can meet.
            DataError: for records that differ in channels or sample time, too few samples, or something that is not a
                record.
        """
        several = given_records(records, reading)
        others = () if isinstance(unseen, (int, float)) else given_records(unseen, reading)
        several, others = tuple(map(without_faults, several)), tuple(map(without_faults, others))
        record = _long_enough(as_one(several))
        check_sizes(record)
        names = names or usual_for(record, (*options.fixed, *options.datasheet, *options.free), control)
        if lift_an_arm(names):
            several, others = tuple(map(without_stops, several)), tuple(map(without_stops, others))
            record = _long_enough(as_one(several))
        asked = understood(options, names)
        responses = tuple(map(response_of, several))
        options, about_delay = with_delay(codes_of_channel(asked, record), several)
        pole = unstable_pole(record)
        if pole is not None:  # by free runs, the orders of a stable model would be chosen
            options = replace(options, na=options.na or ORDER, nb=options.nb or ORDER)
        plants = plants_of(names, options)
        check_physics(plants, names, options)
        to_fit, test = (record, as_one(others)) if others else hold_back_records(several, _fraction(unseen), as_one)
        _check_records(to_fit, test, [name for name in names if name not in plants], transient)
        train, outside = to_compare(to_fit, names)
        data = several, others, record, to_fit, train, outside, test
        return cls(*data, names, plants, asked, options, transient, responses, about_delay, pole)

    @property
    def is_excerpt(self) -> bool:
        """Whether the models are fitted to a part of the data only."""
        return self.train is not self.to_fit

    def findings(self, *, quick: bool) -> list[Finding]:
        """What the data and the request show before any model is fitted.

        Args:
            quick: whether the usual models that take longer are left out.
        """
        return [
            *self.record.findings,
            *self._about_the_unseen_part(),
            *questions(self.records, self.responses),
            *self.about_delay,
            *about_the_loop(self.record, self.pole),
            *unused_requests(self.plants, self.names, self.asked, self.record, quick=quick),
            *(each.about(name) for name, plant in self.plants.items() for each in self._assumptions(plant)),
        ]

    def _about_the_unseen_part(self) -> list[Finding]:
        """That another part than the end is unseen, or that no part of the record is fit to be unseen."""
        size = len(self.unseen)
        if self.others or len(self.unseen.segments) > 1 or len(self.unseen) + len(self.to_fit) != len(self.record):
            return []
        share = float(shares(self.record, len(self.record) - size, len(self.record))[0])
        first = round((self.unseen.time[0] - self.record.time[0]) / self.record.dt)
        if share >= FAIR or self.record.breaks:
            return []
        moved = first + size < len(self.record)
        data = {"share": share, "first": first, "last": first + size - 1, "moved": moved}
        return [Finding("end-shows-little", self.record.name, data)]

    def _assumptions(self, plant: Plant) -> list[Finding]:
        """The units that are assumed of channels without one; none where the input cannot drive the plant."""
        try:
            return assumptions(plant.for_command(with_unit_of_name(self.record)), self.record)
        except ModelError:  # its fit says why
            return []


def _long_enough(record: Record) -> Record:
    """The record.

    Raises:
        DataError: where it has too few samples to fit a model and to test it.
    """
    if len(record) >= FEWEST:
        return record
    raise DataError(
        f"{record.name}: {len(record)} samples are too few to fit a model and to test it; record at least {FEWEST}",
        arguments=("rows",),
    )


def _check_records(train: Record, test: Record, discrete: Sequence[str], transient: int | None) -> None:
    """Refuse too few samples to fit, data of another sample time, and a transient that leaves no sample.

    Raises:
        DataError: naming the models, or the record.
    """
    if discrete and not np.isclose(train.dt, test.dt, rtol=1e-3, atol=0.0):
        raise DataError(
            f"{test.name} is sampled every {test.dt:g} s and {train.name} every {train.dt:g} s, so "
            f"{', '.join(discrete)} cannot be simulated on it; resample one of them, or check the unit of its times"
        )
    if len(train) < FEWEST_FITTED:
        left = f"{len(train)} sample{'s' * (len(train) != 1)} to fit; keep a smaller part unseen, or record longer"
        raise DataError(f"{test.name}, of {len(test)} samples, leaves {left}", arguments=("unseen",))
    for record in (train, test):
        longest = max(map(len, record.segments))
        if longest <= (transient or 0):
            left = f"leaves no sample for an error; the longest segment has {longest}"
            raise DataError(f"{record.name}: a transient of {transient} samples {left}", arguments=("transient",))


def _fraction(unseen: Any) -> float:
    """The fraction to keep unseen.

    Raises:
        DataError: where it is none.
    """
    if isinstance(unseen, (int, float)) and 0 < unseen < 1:
        return float(unseen)
    raise DataError(f"unseen: {unseen!r} is not a fraction between 0 and 1, nor a record", arguments=("unseen",))
