"""The complete study of Kara and Abokoos: what `emsid study` does.

There are two studies. *Experiment* uses a bench with noise, quantisation and effects that no model contains (Table 2 of
the paper), or two records of the user. *Simulation* uses the noise-free motor (Table 1). Each has two records with
different inputs: identification data and unseen data.

Least squares and recursive least squares estimate the paper's linear and nonlinear structures, its complete regression
of a higher degree and a regression with friction terms. A Wiener–Hammerstein cascade and the physical motor as one mass
are fitted to the free run. On the noise-free records the motor with its shaft is estimated too. This checks the
estimator, because plant and model have the same equations.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from emsid.errors import DataError, EmsidError
from emsid.estimation.borders import border, collected, note, tried
from emsid.estimation.fit import Ending, Fit, fit_or_problem
from emsid.estimation.linear.least_squares import least_squares
from emsid.estimation.linear.recursive import recursive_least_squares
from emsid.estimation.nonlinear.compilation import cancelled_with
from emsid.estimation.nonlinear.control import FREE, Control, Stopped
from emsid.findings import Finding
from emsid.first_look.faults import without_faults
from emsid.models.regression.narx import Structure
from emsid.plant import Bench, Motor
from emsid.record import Record, check_same_channels
from emsid.study.models import (
    BLOCKS,
    EXPERIMENT,
    IDENTIFICATION,
    SIMULATION,
    UNSEEN,
    Settings,
    chosen,
    load_friction_difference,
    measure,
    of_the_paper,
    searches,
    structures,
)
from emsid.study.survey import (
    EXAMPLE,
    Excitation,
    LoadFriction,
    PriorRow,
    Richer,
    Survey,
    excitation_of,
    load_friction,
    priors,
    recorded,
    regressions,
    richer_input,
)
from emsid.validation.comparison import Assessment, Row, assess


@dataclass(frozen=True, eq=False)
class Part:
    """One of the two studies.

    Attributes:
        name: ``simulation`` or ``experiment``.
        identification, unseen: the record that the models were fitted to, and the unseen record.
        fits: every model by every method.
        assessed: every fit on the identification and on the unseen record, in the order of the fits.
        failed: the reason for every model that could not be fitted.
        interrupted: whether the user stopped it before all models were done.
        excitations: what the two inputs excite.
        priors: recursive against batch least squares, for several P(0).
        own: whether the records are the user's.
    """

    name: str
    identification: Record
    unseen: Record
    fits: tuple[Fit[Any], ...]
    assessed: tuple[tuple[Assessment, Assessment], ...]
    failed: Mapping[str, EmsidError] = field(default_factory=dict)
    interrupted: bool = False
    excitations: tuple[Excitation, ...] = ()
    priors: tuple[PriorRow, ...] = ()
    own: bool = False

    @property
    def called(self) -> str:
        """What texts call it: an experiment without records of the user is that of a virtual bench."""
        return self.name if self.own or self.name == SIMULATION else "virtual bench"

    @property
    def rows(self) -> list[Row]:
        """A row for every model, method and record."""
        return [each.row for pair in self.assessed for each in pair]

    def on_identification(self, model: str, method: str = "") -> Assessment:
        """A model on the record it was fitted to; without ``method``, by the first method it was fitted with."""
        return next(i for i, _ in self.assessed if i.row.model == model and method in ("", i.row.method))

    def on_unseen(self, model: str, method: str = "") -> Assessment:
        """A model on the unseen record; without ``method``, by the first method it was fitted with."""
        return next(v for _, v in self.assessed if v.row.model == model and method in ("", v.row.method))

    @property
    def models(self) -> tuple[str, ...]:
        """The names of the models, in order."""
        return tuple(dict.fromkeys(fit.model.name for fit in self.fits))


@dataclass(frozen=True, eq=False)
class Study:
    """Result of the study.

    Attributes:
        settings: how it was set up.
        load_friction_mse: mean square difference of the outputs with and without friction on the load side.
        output_variance: variance of the output with it, for comparison.
        parts: the studies that were done, the experiment first.
        own_records: whether the experiment uses records of the user.
        interrupted: whether the user stopped it before all was done.
        survey: other motors, inputs and records; recorded with the default settings.
        load_friction: what friction on the load costs.
        richer: what an input with more frequencies changes.
        example: regressions on one motor of the family, on identification data and on unseen data.
        noted: findings about parts that failed; everything else is complete.
    """

    settings: Settings
    load_friction_mse: float
    output_variance: float
    parts: tuple[Part, ...]
    own_records: bool = False
    interrupted: bool = False
    survey: Survey | None = None
    load_friction: LoadFriction | None = None
    richer: Richer | None = None
    example: tuple[tuple[Assessment, Assessment], ...] = ()
    noted: tuple[Finding, ...] = ()

    @property
    def rows(self) -> list[Row]:
        """All rows of all parts."""
        return [row for part in self.parts for row in part.rows]

    def part(self, name: str) -> Part:
        """One of the parts, by its name."""
        return next(part for part in self.parts if part.name == name)


def study(
    settings: Settings | None = None,
    records: tuple[Record, Record] | None = None,
    control: Control = FREE,
) -> Study:
    """Run the study.

    Args:
        settings: by default those of the paper's motor.
        records: identification data and unseen data of a real drive, in place of the virtual bench.
        control: when to stop, and where to report progress. If a part is stopped, its finished models are kept.

    Raises:
        DataError: for records whose channels differ, or whose input is the same.
        Stopped: if it is stopped before the first part.
        EmsidError: where no part has a model.
    """
    settings = settings or Settings()
    with collected() as noted:
        with cancelled_with(control):
            control.doing("the motor with and without friction on the load side")
            difference, variance = tried(
                "friction on the load side", lambda: load_friction_difference(settings), (np.nan, np.nan)
            )
            control.doing("simulating the motor")
            pairs = _records(settings, records)
        parts, problems, stopped = list[Part](), dict[str, EmsidError](), False
        for name, (first, second) in pairs.items():
            own = name == EXPERIMENT and records is not None
            try:
                with border(name, report=partial(problems.__setitem__, name)):
                    parts.append(_part(name, first, second, settings, control, own=own))
            except Stopped:
                if not parts:
                    raise
                stopped = True
            if stopped := stopped or control.ending is not None or any(part.interrupted for part in parts):
                break
        if not parts:
            raise next(iter(problems.values()))
        for name, problem in problems.items():
            note(name, problem)
        survey = tried("survey", recorded, None)
        done = Study(settings, difference, variance, tuple(parts), records is not None, stopped, survey)
        if not stopped:
            done = _beyond(done, control)
    return replace(done, noted=tuple(noted))


def _beyond(done: Study, control: Control) -> Study:
    """The study with what goes beyond its two parts; as it is where it is stopped there."""
    settings = done.settings
    try:
        control.doing(f"motor {EXAMPLE.name}")
        done = replace(done, example=tried(f"motor {EXAMPLE.name}", lambda: tuple(regressions(EXAMPLE, settings)), ()))
        done = replace(done, richer=tried("an input with more sines", lambda: richer_input(settings), None))
        for part in done.parts:
            if part.name == SIMULATION and BLOCKS in part.models:
                blocks: Any = part.on_unseen(BLOCKS).fit.model
                with border("curve of the friction on the load side"):
                    done = replace(done, load_friction=load_friction(settings, blocks, control))
        return done
    except Stopped:
        return replace(done, interrupted=True)


def _records(settings: Settings, given: tuple[Record, Record] | None) -> dict[str, tuple[Record, Record]]:
    """Two records for every study, by name of the study.

    Raises:
        DataError: for records whose channels differ, or whose input is the same.
    """
    rng = np.random.default_rng(settings.seed)
    simulated, measured = (
        (measure(settings, bench, IDENTIFICATION, rng), measure(settings, bench, UNSEEN, rng))
        for bench in (Bench(), settings.bench)
    )
    measured = measured if given is None else (without_faults(given[0]), without_faults(given[1]))
    check_same_channels(*measured)
    if np.array_equal(measured[0].input, measured[1].input):
        raise DataError(
            f"{measured[0].name} and {measured[1].name} have the same input; give an unseen record with another input"
        )
    return {EXPERIMENT: measured, SIMULATION: simulated}


def _part(name: str, first: Record, second: Record, settings: Settings, control: Control, *, own: bool = False) -> Part:
    """One of the studies; if it is interrupted, with the models finished by then.

    On records of the user, the sizes of all models but the paper's are chosen.

    Raises:
        Stopped: if it is interrupted before the first model.
    """
    candidates = of_the_paper() if own else structures(first, settings.knots)
    shaft = name == SIMULATION and not settings.motor.is_rigid
    known = {} if settings.motor == Motor() else {"resistance": settings.motor.resistance}
    nonlinear = chosen(first, known) if own else searches(settings.motor, first, shaft=shaft)
    done = _fitted(name, first, candidates, nonlinear, settings.forgetting, control)
    # All models are compared on the same samples.
    memories = (*(candidate.memory for candidate in candidates), *(fit.model.memory for fit in done.fits))
    start = max(settings.transient or 0, *memories)
    kind = "given" if own else "two sines"
    assessed: list[tuple[Assessment, Assessment]] = []
    for fit in done.fits:
        with border(fit.model.name, report=partial(done.failed.__setitem__, fit.model.name)):
            seen, unseen = (
                assess(fit, record, start, experiment=name, data=data)
                for record, data in ((first, IDENTIFICATION), (second, UNSEEN))
            )
            assessed.append((seen, unseen))
    if not assessed:
        raise next(iter(done.failed.values()))
    fits: tuple[Fit[Any], ...] = tuple(each.fit for each, _ in assessed)
    regressions = [fit.model.structure for fit in fits if fit.method == "ls"]
    return Part(
        name,
        first,
        second,
        fits,
        tuple(assessed),
        done.failed,
        done.interrupted,
        tried(f"excitation of the {name}", lambda: tuple(excitation_of(each, kind) for each in (first, second)), ()),
        tried(f"priors of the {name}", lambda: priors(regressions, first, second, start), ()),
        own=own,
    )


@dataclass
class _Fitted:
    """The models of a part that are done, why others failed, and whether the rest was left out."""

    fits: list[Fit[Any]] = field(default_factory=list)
    failed: dict[str, EmsidError] = field(default_factory=dict)
    interrupted: bool = False


def _fitted(
    name: str,
    record: Record,
    candidates: Sequence[Structure],
    nonlinear: Mapping[str, Callable[[Control], Fit[Any]]],
    forgetting: float,
    control: Control,
) -> _Fitted:
    """Every regression by batch and by recursive least squares, then the nonlinear models.

    Raises:
        Stopped: if it is interrupted before the first model.
    """
    done, total = _Fitted(), len(candidates) + len(nonlinear)
    try:
        with cancelled_with(control):
            for k, structure in enumerate(candidates):
                if done.fits:  # the first regression takes no time, and a part without a model shows nothing
                    control.doing(f"{name}: {structure.name}", k, total)
                with border(structure.name, report=partial(done.failed.__setitem__, structure.name)):
                    done.fits.append(least_squares(structure, record))
                    recursive = recursive_least_squares(structure, record, forgetting=forgetting, history=True)
                    done.fits.append(recursive)
            for k, (model, search) in enumerate(nonlinear.items(), len(candidates)):
                control.doing(f"{name}: {model}", k, total)
                with border(model, report=partial(done.failed.__setitem__, model)):
                    done.fits.append(fit_or_problem(partial(search, control)))
                if done.fits and done.fits[-1].ending is Ending.INTERRUPTED:
                    done.interrupted = True
                    break
    except Stopped:
        if not done.fits:
            raise
        done.interrupted = True
    return done
