"""`Fit`: the result of an estimator, with its uncertainty and how the search ended.

A fit is its model with a table of what was found: ``fit["b1"].interval``, and ``fit.simulate(record)`` is that of the
model.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from math import isfinite
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from emsid.arguments import did_you_mean
from emsid.errors import ModelError, some
from emsid.estimation.estimates import Estimate, Status, assumed_in
from emsid.findings import Finding, plain
from emsid.presentation import Presented, analysis
from emsid.record.channels import ChannelNames
from emsid.record.frames import frame
from emsid.record.record import Record

Array = NDArray[np.float64]
M = TypeVar("M", covariant=True)
T = TypeVar("T")


class Ending(Enum):
    """How an estimation ended; only the first two give the estimate that was asked for."""

    SOLVED = "solved"  # a linear problem, by factorisation or recursion
    CONVERGED = "converged"  # a nonlinear search, at a minimum
    RANK_DEFICIENT = "rank deficient"  # the data do not determine every parameter
    STALLED = "stalled"  # no step lowers the cost, although this is not a minimum
    OUT_OF_BUDGET = "out of budget"  # iterations or time ran out
    INTERRUPTED = "interrupted"  # cancelled by the user; the best estimate so far is kept

    @property
    def before_minimum(self) -> bool:
        """Whether a search ended where the cost could still be lowered."""
        return self in (Ending.STALLED, Ending.OUT_OF_BUDGET, Ending.INTERRUPTED)


FITTED = {"ls": "one step", "rls": "recursive", "iv": "instruments", "pem": "one step", "gn": "free run"}
"""What a method makes small, in words for tables; another method has its name."""


@dataclass(frozen=True, eq=False, repr=False)
class Fit(Presented, Generic[M]):
    """A model fitted to a record.

    Attributes:
        model: the model with the estimated parameters.
        names: a name for each of the p free parameters.
        estimate: (p,) their values.
        covariance: (p, p) of the estimate; infinite on the diagonal of parameters that the data do not determine.
        noise_variance: of the residual that was minimised, in its unit squared.
        samples: the number of equations.
        condition: condition number of the problem with its columns scaled to unit length.
        rank: the number of parameters, or combinations of them, that the data determine.
        ending: how it ended.
        method: short name for tables: ``ls``, ``rls``, …
        iterations: steps that a nonlinear search took.
        history: (k, p) estimate after every sample or step, if requested.
        findings: facts about the estimate and the end of the search; `emsid.wording` makes sentences of them.
        dependent: how many of the estimates follow from the others, as where the unit of a signal is that of a sum.
        table: a row for every parameter with what is known of it besides the estimate, such as its unit; empty where
            there is no more. It may have rows for parameters that are fixed or kept.
        channels: name and unit of the channels of its records; None where not known.
        output_noise: (ny,) standard deviation of what is left of every output, in its unit; None where not known.

    Everything else is looked up in the model: ``fit.simulate``, ``fit.dt``, ``fit.equation``.
    """

    model: M
    names: tuple[str, ...]
    estimate: Array
    covariance: Array
    noise_variance: float
    samples: float
    condition: float
    rank: int
    ending: Ending = Ending.SOLVED
    method: str = "ls"
    iterations: int = 0
    history: Array | None = None
    findings: tuple[Finding, ...] = ()
    dependent: int = 0
    table: tuple[Estimate, ...] = ()
    channels: ChannelNames | None = None
    output_noise: Array | None = None

    __iter__ = None  # it is looked up by name, and no sequence

    if not TYPE_CHECKING:  # a type checker does not know what a model of any kind has

        def __getattr__(self, name: str) -> Any:
            if name.startswith("_") or "model" not in self.__dict__:
                raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")
            try:
                return getattr(self.model, name)
            except AttributeError:
                near = did_you_mean(name, dir(self))
                raise AttributeError(f"a fit of {self.model_name} has no attribute {name!r}{near}") from None

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *(name for name in dir(self.model) if not name.startswith("_"))})

    def __getitem__(self, name: str) -> Estimate:
        """The row of a parameter by its name or symbol.

        Raises:
            ModelError: for an unknown name, with the known ones.
        """
        rows = self.parameters
        if name in rows:
            return rows[name]
        called = [row for row in rows.values() if row.symbol and row.symbol == name]
        if len(called) == 1:
            return called[0]
        near = did_you_mean(str(name), rows)
        raise ModelError(f"{self.model_name} has no parameter {name!r}; it has {some(rows)}{near}")

    @property
    def model_name(self) -> str:
        """The name of its model, for tables and messages."""
        return getattr(self.model, "name", type(self.model).__name__)

    @property
    def parameters(self) -> dict[str, Estimate]:
        """Every parameter with value, standard error, 95 % interval, unit and status, by name."""
        return {row.name: row for row in self.table or self._rows()}

    @property
    def assumed(self) -> tuple[Estimate, ...]:
        """The rows of the table whose values nobody gave or measured, and on which estimates depend.

        They were kept, are built in, or ended at a bound that holds others. An estimate depends on one if it moves by
        more than half a standard error where the value is doubled; of zero, where it changes by its plausible size.
        """
        return assumed_in(self.table)

    def _rows(self) -> tuple[Estimate, ...]:
        """A row for every estimate, from estimates and covariance alone."""
        rows = []
        for name, value, error, ends in zip(
            self.names, self.estimate.tolist(), self.standard_error.tolist(), self.interval().tolist(), strict=True
        ):
            known = not self.biased and isfinite(error)
            status = Status.PREDICTOR if self.biased else Status.ESTIMATED if known else Status.UNDETERMINED
            interval = (ends[0], ends[1]) if known else None
            rows.append(Estimate(name, "", "", "", value, error if known else None, status, interval=interval))
        return tuple(rows)

    def at(self, model: Any) -> Fit[Any]:
        """The fit with a model of the same structure whose parameters are from more data; it keeps standard errors.

        Args:
            model: with ``parameter_values``; one of other parameters has no estimates here.
        """
        values = model.parameter_values()
        if not set(self.names) <= values.keys():
            empty = np.empty(0)
            return Fit(model, (), empty, np.empty((0, 0)), self.noise_variance, self.samples, np.nan, 0, self.ending)
        rows = []
        for row in self.table:
            value = values.get(row.name, row.value)
            shift = value - row.value
            interval = None if row.interval is None else (row.interval[0] + shift, row.interval[1] + shift)
            rows.append(replace(row, value=value, interval=interval))
        return replace(self, model=model, estimate=np.array([values[n] for n in self.names]), table=tuple(rows))

    def __repr__(self) -> str:
        name = self.model_name
        short = name if len(name) <= 40 else f"{name[:39]}…"
        count = f"{self.size} parameter{'s' * (self.size != 1)}"
        return f"{type(self).__name__}({short}, {self.fitted}: {count}, {self.ending.value})"

    @property
    def fitted(self) -> str:
        """How it was fitted, in words: to the prediction one step ahead, to the free run, …"""
        return FITTED.get(self.method, self.method)

    @property
    def sample_time(self) -> float | None:
        """The sample time of its model, else that of the records; None where neither is known."""
        own: float | None = getattr(self.model, "dt", None)
        return own if own is not None or self.channels is None else self.channels.dt

    def to_control(self, *arguments: Any) -> Any:
        """The linear part of the model for python-control, with the names and units of its channels.

        Args:
            arguments: as the model takes them.
        """
        if not hasattr(self.model, "to_control"):
            raise AttributeError(f"a fit of {self.model_name} has no attribute 'to_control'")
        system = self.model.to_control(*arguments)
        if self.channels is not None and hasattr(system, "set_inputs"):
            system.name = self.model_name
            system.set_inputs(self.channels.inputs_in_units)
            system.set_outputs(self.channels.outputs_in_units)
        return system

    def simulate(self, record: Any, transient: int | None = None, *, dt: float | None = None) -> Any:
        """Free run of the model; inputs alone are taken at the sample time of the record it was fitted to.

        Args:
            record: a record, or inputs (N,) or (N, nu) alone.
            transient: samples that start a segment in motion.
            dt: sample time in s of inputs alone.
        """
        return self.model.simulate(record, transient, dt=dt or self.sample_time)  # type: ignore[attr-defined]

    def residuals(self, record: Record) -> Any:
        """What the model leaves of the outputs of a record, with its tests; see `emsid.residuals`."""
        return analysis().residuals(self, record)

    @property
    def size(self) -> int:
        """The number of estimates, without those that follow from others."""
        return len(self.estimate) - self.dependent

    @property
    def standard_error(self) -> Array:
        """(p,) standard deviation of every estimate."""
        spread: Array = np.sqrt(np.diag(self.covariance))
        return spread

    @property
    def biased(self) -> bool:
        """Whether its estimates are only those of the best one-step predictor, and not of the system.

        Tables and files then have no intervals; `interval` and `covariance` are those of the predictor.
        """
        return any(finding.code == "regression-biased" for finding in self.findings)

    @property
    def has_intervals(self) -> bool:
        """Whether its estimates have intervals: not those of a biased regression, or of a search that stalled."""
        spread = self.standard_error
        return not self.biased and bool(not np.isinf(spread).any() or (np.isfinite(spread) & (spread > 0)).any())

    @property
    def has_bands(self) -> bool:
        """Whether its curves have bands: with intervals, of a search that ended at a minimum.

        Elsewhere the covariance says how flat the cost is there, and not how far away the minimum is.
        """
        return self.has_intervals and not self.ending.before_minimum

    @property
    def status(self) -> str:
        """Whether its estimates are those of the system, or only of the best one-step predictor."""
        return "of the one-step predictor" if self.biased else "estimated"

    def interval(self, level: float = 0.95) -> Array:
        """(p, 2) confidence interval of every parameter, by the normal distribution; see `biased`."""
        from scipy.special import ndtri

        half = float(ndtri(0.5 + level / 2)) * self.standard_error
        return np.column_stack([self.estimate - half, self.estimate + half])

    def to_frame(self, library: str = "polars") -> Any:
        """A data frame with a row for every parameter: value, unit, ends of the 95 % interval, status.

        Args:
            library: ``"polars"`` or ``"pandas"``.
        """
        rows = list(self.parameters.values())
        nothing = (np.nan, np.nan)
        low, high = np.array([row.interval or nothing for row in rows], dtype=float).reshape(-1, 2).T
        return frame(
            {
                "parameter": np.array([row.name for row in rows], dtype=str),
                "value": np.array([row.value for row in rows], dtype=float),
                "unit": np.array([row.unit for row in rows], dtype=str),
                "low": low,
                "high": high,
                "status": np.array([str(row.status.value) for row in rows], dtype=str),
            },
            library,
        )

    def to_data(self) -> dict[str, Any]:
        """Every estimate with its interval, and every finding, in built-in types; None where not finite."""
        how = self.status
        parameters = [
            {"name": name, "unit": "", "value": value, "status": how}
            | {"standard_error": None if self.biased else error, "interval": None if self.biased else ends}
            for name, value, error, ends in zip(
                self.names,
                self.estimate.tolist(),
                self.standard_error.tolist(),
                self.interval().tolist(),
                strict=True,
            )
        ]
        data: dict[str, Any] = plain(
            {
                "model": getattr(self.model, "name", ""),
                "method": self.method,
                "ending": self.ending.value,
                "iterations": int(self.iterations),
                "samples": float(self.samples),
                "noise_variance": float(self.noise_variance),
                "condition": float(self.condition),
                "rank": int(self.rank),
                "parameters": parameters,
                "assumed": [row.name for row in self.assumed],
                "findings": [finding.to_data() for finding in self.findings],
            }
        )
        return data


def fit_or_problem(search: Callable[[], T]) -> T:
    """The result of a search.

    Raises:
        ModelError: also where the linear algebra fails because numbers are out of range.
    """
    try:
        return search()
    except (ValueError, ArithmeticError) as problem:
        raise ModelError(
            f"the numbers are out of range ({problem}); scale the channels, check the sample time",
            arguments=("scale", "dt"),
        ) from problem
