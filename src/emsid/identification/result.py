"""`Identification`: the result of an identification.

Characteristics of a drive with intervals: gain, time constant, dead zone, friction.

The curves of a fitted model with their confidence bands, as numbers for a file: what the page draws.

A curve that a model does not have is left out: a static map of a model that does not come to rest, friction of a model
without any. See `emsid.validation.bands` for the meaning of every curve and its band.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, partial
from itertools import product
from math import inf, isfinite
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from emsid.estimation.borders import border, collected
from emsid.estimation.estimates import HALF_WIDTH, Estimate, Status
from emsid.estimation.fit import Fit
from emsid.findings import Finding, plain
from emsid.identification.evidence import next_steps, verdicts
from emsid.identification.ranking import FrontRow, Ranked, front_rows
from emsid.identification.verdict import OF_SENSORS, experiment, recommendation
from emsid.models.bands import BandedCurve, banded_curve, output_of
from emsid.models.characteristics import Characteristic
from emsid.models.kinds import capabilities_of
from emsid.presentation import Presented
from emsid.record import Record, concatenate
from emsid.record.channels import ChannelNames
from emsid.record.frames import frame
from emsid.validation.bands import frequency_response_band, step_response_band, usual_step
from emsid.validation.comparison import Comparison, RecordError, RegionError, by_region

if TYPE_CHECKING:
    from emsid.estimation.fit import Fit
    from emsid.models.model import Model
    from emsid.models.plants.search.diagnostics import Profile
    from emsid.validation.comparison import Comparison, Row


Part = TypeVar("Part")


@dataclass(frozen=True, eq=False, repr=False)
class Identification(Presented):
    """Result of an identification.

    Attributes:
        record: the data that the models were fitted to; of a long record an excerpt, from which the recommended one was
            then fitted to all (`fitted-to-excerpt`).
        unseen: the data that their errors are from, and that they were ranked on where `on_choice` is None.
        on_record: the models on `record`.
        on_unseen: the models on `unseen`, the chosen one first.
        findings: all findings, including those of the fits; a finding about a model has its name in the data.
        profiles: likelihood profiles of physical parameters, by model.
        interrupted: whether it was stopped before its end; then residuals are not tested, and there are no curves.
        on_choice: the models on further unseen data that chose among them; None where `unseen` did.
        model_verdicts: the verdict on every model, with its residual tests and reasons, the recommended one first.
        ranking: the models with their errors over the folds that ranked them, the smallest first.
        on_all_data: the chosen model with its parameters from `record` and `unseen`; None where that changes little,
            and where data for the choice were given.
        by_record: the errors of the models on every record as a whole, where there are several.
        whole: of a long record all data that `chosen` was fitted to in the end; None where these are `record`.
    """

    record: Record
    unseen: Record
    on_record: Comparison
    on_unseen: Comparison
    findings: tuple[Finding, ...] = ()
    profiles: Mapping[str, tuple[Profile, ...]] = field(default_factory=dict)
    interrupted: bool = False
    on_choice: Comparison | None = None
    model_verdicts: tuple[Finding, ...] = ()
    ranking: tuple[Ranked, ...] = ()
    on_all_data: Model | None = None
    by_record: tuple[RecordError, ...] = ()
    whole: Record | None = None

    def __repr__(self) -> str:
        best = self.chosen.model.name[:40]
        return f"Identification({len(self.fits)} models on {self.ranked_on}; best {best})"

    def to_frame(self, library: str = "polars") -> Any:
        """A data frame with a row for every model: errors on unseen data, number of parameters and verdict.

        ``verdict`` is one of ``supported``, ``limited``, ``implausible`` and ``unusable``, or empty without one;
        ``chosen`` is true for `chosen`.

        Args:
            library: ``"polars"`` or ``"pandas"``.
        """
        verdicts = {each.model: each.code.removeprefix("model-") for each in self.model_verdicts}
        rows = self.rows
        columns: dict[str, Any] = {
            name: np.array([getattr(row, name) for row in rows])
            for name in ("model", "fit_percent", "simulation_rmse", "one_step_mse", "parameters", "samples")
        }
        columns["verdict"] = np.array([verdicts.get(row.model, "") for row in rows], dtype=str)
        columns["chosen"] = np.array([row.model == self.chosen.model.name for row in rows])
        return frame(columns, library)

    @property
    def chosen(self) -> Fit[Any]:
        """The best model: the best free run on the data that chose, or a plausible one as good within noise."""
        return self.on_unseen.best.fit

    @property
    def is_usable(self) -> bool:
        """Whether `chosen` can be used; where no model can, it is only the one with the smallest error."""
        return self.model_verdicts[0].code != "model-unusable"

    @property
    def is_recommended(self) -> bool:
        """Whether `chosen` is recommended: it can be used, and no finding forbids to recommend it."""
        return self.recommendation[0].code == "model-recommended"

    @property
    def of_sensor(self) -> Finding | None:
        """What was found about how the channels were measured, after which no estimate is known; None for nothing."""
        return next((each for each in self.findings if each.code in OF_SENSORS), None)

    @property
    def known(self) -> list[Estimate]:
        """The parameters of `chosen` that the data determine; none of a model or of a sensor that cannot be used."""
        return determined(self.chosen) if self.is_usable and self.of_sensor is None else []

    @cached_property
    def recommended(self) -> Model:
        """The model to use, as the data leave it: `on_all_data`, or that of `chosen`, which the errors are from."""
        model = self.chosen.model if self.on_all_data is None else self.on_all_data
        left: Model = capabilities_of(model).as_left(model, self.fitted_by_recommended)
        return left

    @property
    def recommended_fit(self) -> Fit[Any]:
        """`recommended` with its table of parameters; standard errors are those of `chosen`, which saw less data."""
        fit = self.chosen if self.recommended is self.chosen.model else self.chosen.at(self.recommended)
        return replace(fit, channels=ChannelNames.of(self.record))

    def data_of(self, fit: Fit[Any]) -> Record:
        """The data that one of the models was fitted to."""
        return self.whole if self.whole is not None and fit is self.chosen else self.record

    @property
    def fitted_by_recommended(self) -> Record:
        """The data that `recommended` was fitted to."""
        fitted = self.data_of(self.chosen)
        if self.on_all_data is None:
            return fitted
        choice = () if self.on_choice is None else (self.on_choice.best.record,)
        return concatenate((fitted, *choice, self.unseen))

    @cached_property
    def recommendation(self) -> tuple[Finding, ...]:
        """The recommended model with the reasons for it, and unless interrupted what to do next.

        First comes what to measure instead of assuming it, if estimates depend on that, then the experiment to run.
        """
        verdict = self.model_verdicts[0]
        why = recommendation(self.on_unseen, self.ranking, verdict, self.findings, seen=self.seen)
        if self.interrupted:
            return (why,)
        fit, nothing = self.chosen, tuple[Finding, ...]()

        def what() -> tuple[Finding, ...]:
            one_load, current = (any(f.data.get(key) for f in fit.findings) for key in ("one_load", "current_missing"))
            data = {"parameters": [row.name for row in fit.assumed], "current": current}
            measure = (Finding("next-measure", fit.model.name, data),) if fit.assumed else ()
            tests: dict[str, list[str]] = {}
            for code, names in ((code, names) for f in fit.findings for code, names in f.data.get("tests", {}).items()):
                tests.setdefault(code, []).extend(names)
            if tests:
                return (*measure, Finding("next-test", fit.model.name, {"tests": tests}))
            return (*measure, experiment(verdict, self.record, self.unseen, seen=self.seen, one_load=one_load))

        return (why, *self._part("what to measure next", what, nothing))

    @property
    def fits(self) -> tuple[Fit[Any], ...]:
        """The models, the best free run first."""
        return self.on_unseen.fits

    @cached_property
    def front(self) -> tuple[FrontRow, ...]:
        """Accuracy against number of parameters of the models that were compared, from simple to complex."""
        name = self.chosen.model.name if self.is_recommended else ""
        return self._part("accuracy against number of parameters", lambda: front_rows(self.ranking, name), ())

    @cached_property
    def by_region(self) -> tuple[RegionError, ...]:
        """The errors of the models on the unseen data by operating region, the smallest error of all first."""
        return self._part("errors by region", lambda: by_region(self.on_unseen.by_error), ())

    @cached_property
    def seen(self) -> bool:
        """Whether `unseen` contains data that the models were fitted to."""
        return any(finding.code == "data-not-unseen" for finding in self.findings)

    @property
    def rows(self) -> tuple[Row, ...]:
        """The errors on `unseen`, the smallest first, as errors on data of the fit where it contains some."""
        rows = self.on_unseen.by_error.rows
        return tuple(replace(row, data="identification") for row in rows) if self.seen else rows

    @property
    def ranked_on(self) -> str:
        """Name of the data that the errors are from, for titles."""
        return "the data they were fitted to" if self.seen else "unseen data"

    @cached_property
    def characteristics(self) -> tuple[Characteristic, ...]:
        """Gain, time constant, dead zone and friction, as far as the models have them, with their intervals.

        A plant that is unstable without its controller never settles, so it has none of them, and neither has one
        whose sensor cannot be used.
        """
        if self.of_sensor is not None or any(finding.code == "unstable-in-loop" for finding in self.findings):
            return ()
        return self._part("characteristics", lambda: characteristics(self.on_unseen, self.record), ())

    @cached_property
    def curves(self) -> tuple[BandedCurve, ...]:
        """Responses, static map, friction and dead zone of the chosen model with 95 % bands, as far as it has them.

        There are none where the identification was interrupted.
        """
        return () if self.interrupted else self._part("curves", lambda: curves(self.chosen, self.record), ())

    @cached_property
    def verdicts(self) -> tuple[Finding, ...]:
        """Whether the residual of the best free run depends on the input, for every output; none if interrupted."""
        return () if self.interrupted else self._part("residual test", lambda: verdicts(self.on_unseen.best), ())

    @cached_property
    def next_steps(self) -> tuple[Finding, ...]:
        """What to do next besides another experiment, the most useful first."""
        own = next(each for each in self.ranking if each.name == self.chosen.model.name)
        over_folds = own.fit_percent if len(own.folds) > 1 else -inf
        found = (*self.verdicts, *self.findings)
        is_best = self.on_unseen.by_error.best.row.model == own.name
        best = self.on_unseen.best

        def steps() -> tuple[Finding, ...]:
            return tuple(next_steps(best, found, self.fits, self.record, over_folds, is_best=is_best))

        return self._part("next steps", steps, ())

    def _part(self, name: str, work: Callable[[], Part], otherwise: Part) -> Part:
        """What follows from the models; where that fails, `otherwise`, and a finding more."""
        with collected() as noted, border(name):
            otherwise = work()
        new = [each for each in noted if each not in self.findings]
        object.__setattr__(self, "findings", (*self.findings, *new))
        return otherwise

    def to_data(self) -> dict[str, Any]:
        """The content of ``result.json``; see `emsid.identification.result_format`."""
        rows = (*self.on_record.rows, *(self.on_choice.rows if self.on_choice else ()), *self.on_unseen.rows)
        from emsid.identification.result_format import FORMAT, VERSION

        content = {
            "format": FORMAT,
            "version": VERSION,
            "interrupted": self.interrupted,
            "fits": [fit.to_data() for fit in self.fits],
            "rows": [row.to_data() for row in rows],
            "chosen": self.chosen.model.name,
            "front": [asdict(row) for row in self.front],
            "regions": [asdict(each) for each in self.by_region],
            "records": [asdict(each) for each in self.by_record],
            "profiles": [{"model": name} | each.to_data() for name, some in self.profiles.items() for each in some],
            "characteristics": [each.to_data() for each in self.characteristics],
            "curves": [each.to_data() for each in self.curves],
            "recommendation": [finding.to_data() for finding in self.recommendation],
            "verdicts": [finding.to_data() for finding in self.model_verdicts],
            "residual": [finding.to_data() for finding in self.verdicts],
            "next": [finding.to_data() for finding in self.next_steps],
        }
        content["findings"] = [finding.to_data() for finding in self.findings]  # last: those of all parts above
        data: dict[str, Any] = plain(content)
        return data


# Characteristics that a linear model has too.
LINEAR = ("gain", "time constant", "natural frequency", "damping ratio")
# Another model is also used if its free-run RMSE is at most this multiple of the smallest one.
NEARLY = 1.5


def determined(fit: Fit[Any]) -> list[Estimate]:
    """The physical parameters of a model that the data determine: their intervals do not include zero.

    None of them depends on a value that nobody gave. A model without a table of such parameters has none.
    """

    def excludes_zero(row: Estimate) -> bool:
        if row.standard_error is not None:
            return 0 < HALF_WIDTH * row.standard_error < abs(row.value)
        return row.interval is not None and row.interval[0] * row.interval[1] > 0

    rows = capabilities_of(fit.model).physical_rows(fit)
    return [row for row in rows if row.status in (Status.ESTIMATED, Status.CONDITIONAL) and excludes_zero(row)]


def characteristics(comparison: Comparison, record: Record) -> tuple[Characteristic, ...]:
    """The characteristics of the best model, and dead zone and friction of the next model that is nearly as good.

    A model whose free run diverges has neither a steady gain nor a time constant.

    Args:
        comparison: the models on unseen data.
        record: what they were fitted to, for its units.
    """
    least = comparison.best.row.simulation_rmse
    if not isfinite(least):
        return ()
    near = [each.fit for each in comparison.assessments if each.row.simulation_rmse <= NEARLY * least]
    found: list[Characteristic] = []
    for fit in near:
        known = {each.name for each in found}
        new = [e for e in capabilities_of(fit.model).characteristics(fit, record) if e.name not in known]
        found += new if not found else [each for each in new if each.name not in LINEAR]
        if any(each.name not in LINEAR for each in found):
            break
    return tuple(found)


def curves(fit: Fit[Any], record: Record) -> tuple[BandedCurve, ...]:
    """Step and frequency responses of all channels, static map, friction and dead zone, as far as the model has them.

    Args:
        fit: of any kind of model.
        record: with its sample time, channels and ranges.
    """
    inputs, outputs, found = range(record.input.shape[1]), range(record.output.shape[1]), list[BandedCurve]()
    views: list[Callable[[], list[BandedCurve]]] = [partial(_step, fit, record, k) for k in inputs]
    views += [partial(_frequency, fit, record, i, k) for i, k in product(outputs, inputs)]
    for view in (*views, *capabilities_of(fit.model).curves(fit, record)):
        with border(f"curves of {fit.model.name}", fit.model.name, expected=True):
            found += view()
    return tuple(found)


def _step(fit: Fit[Any], record: Record, input: int) -> list[BandedCurve]:
    band = step_response_band(fit, record, input=input)
    make = partial(banded_curve, fit, record, "step response", band, ("time", "s"), input=input)
    return [make(output_of(record, k), output=k, column=k) for k in range(band.value.shape[1])]


def _frequency(fit: Fit[Any], record: Record, output: int, input: int) -> list[BandedCurve]:
    around = usual_step(record.input[:, input])[1]
    both = frequency_response_band(fit, record.dt, output=output, input=input, around=around)
    return [
        banded_curve(fit, record, kind, band, ("frequency", "Hz"), (kind, unit), input=input, output=output)
        for kind, band, unit in (("magnitude", both.magnitude, "dB"), ("phase", both.phase, "deg"))
    ]
