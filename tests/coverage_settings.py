"""How often 95 % intervals hold the truth in adverse settings.

    python tests/coverage_settings.py [records] [setting…]
    python tests/coverage_settings.py 60 small

The records are made by simulators of their own (`independent.settings`, `independent.misfits`,
`independent.regressions`, `independent.joint`). For every parameter it prints the share of intervals that hold the
truth, two standard errors of that share, and how many of the estimates came with an unconditional interval; the rest
are given a held value, or are said to be those of a one-step predictor. Of a small structure that is not the whole
truth (``small``), the values that are given are right; an interval is conditional there where a finding names what is
missing, what the data contradict, what changes over the record, noise that is as slow as the record, or structures that
fit as well.
`make coverage` runs 300 records each; the test suite runs a short form of the same functions.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from scipy.stats import binom

import emsid
from emsid.models.plants.search.result import Status
from independent.fitting import fitted
from independent.joint import GEAR, JOINTS, Counts, Joint
from independent.misfits import MISFITS, Misfit
from independent.regressions import EQUATIONS, Equation
from independent.settings import SETTINGS, Setting

LOW, HIGH = 0.92, 0.98
CHANCE = 0.025
"""How often a share within these bounds may seem to be outside."""
SAID = {
    "effect-missing", "value-contradicted", "parameter-changes", "residual-slow", "alternatives-fit-as-well",
    "built-in-values-kept",
}  # fmt: skip
"""Findings that limit the intervals of a small structure."""


class Interval(NamedTuple):
    """An interval of one fit.

    Attributes:
        name: of the parameter.
        holds: whether it holds the truth.
        given: whether it is said to depend on something that may be wrong.
    """

    name: str
    holds: bool
    given: bool


class Share(NamedTuple):
    """The intervals of one parameter.

    Attributes:
        covered: the share of unconditional intervals that hold the truth; of all, where none is unconditional.
        count: how many these are.
        given: whether all intervals depend on something that may be wrong.
    """

    covered: float
    count: int
    given: bool

    @property
    def margin(self) -> float:
        """Two standard errors of a share of 95 %."""
        return float(2 * np.sqrt(0.95 * 0.05 / self.count))

    @property
    def wrong(self) -> bool:
        """Whether it is below 92 % by more than chance, although it claims to be unconditional."""
        return not self.given and float(binom.cdf(round(self.covered * self.count), self.count, LOW)) < CHANCE

    @property
    def wide(self) -> bool:
        """Whether it is above 98 % by more than chance: the intervals are wider than they need be."""
        return float(binom.sf(round(self.covered * self.count) - 1, self.count, HIGH)) < CHANCE


def of_a_motor(setting: Setting, seed: int) -> Iterable[Interval]:
    """The intervals of a physical motor fitted to one record; a parameter that is kept has none."""
    fit = fitted(setting, seed, fixed={"sensor.average": 1.0} if setting.counts else {})
    for row in fit.table:
        if row.status not in (Status.FIXED, Status.KEPT) and row.interval is not None:
            low, high = row.interval
            yield Interval(row.name, low <= setting.truth[row.name] <= high, bool(row.given))


def of_a_misfit(setting: Misfit, seed: int) -> Iterable[Interval]:
    """The intervals of a small structure fitted to one record."""
    fit = setting.fit(seed)
    said = any(finding.code in SAID for finding in fit.findings)
    for row in fit.table:
        if row.name in fit.names and row.interval is not None:
            low, high = row.interval
            yield Interval(row.name, low <= setting.truth[row.name] <= high, said)


def of_a_regression(equation: Equation, seed: int) -> Iterable[Interval]:
    """The intervals of the ARX structure of an equation fitted to one record."""
    structure = emsid.arx(len(equation.poles), len(equation.zeros))
    fit = emsid.fit(structure, equation.record(seed), free_run=equation.free_run)
    for name, (low, high), truth in zip(fit.names, fit.interval(), equation.truth, strict=True):
        yield Interval(name, bool(low <= truth <= high), fit.status != "estimated")


def of_a_joint(setting: Counts, seed: int) -> Iterable[Interval]:
    """The intervals of a random joint fitted to one record; the gravity of its record hangs by the encoder's zero."""
    joint = Joint.drawn(seed)
    record, phase = joint.record(seed, 800, setting.noise, setting.white)
    fit = emsid.fit(emsid.plants.joint(), record, fixed={"sensor.ratio": GEAR}, search=False)
    for name, value in joint.truth.items():
        low, high = fit[name].interval or (np.nan, np.nan)
        truth = value - phase * (name == "gravity.angle")
        yield Interval(name, low <= truth <= high, False)


INTERVALS = {Setting: of_a_motor, Misfit: of_a_misfit, Equation: of_a_regression, Counts: of_a_joint}


def shares(setting: Setting | Misfit | Equation | Counts, records: int) -> Mapping[str, Share]:
    """The share of intervals that hold the truth, by parameter."""
    found: dict[str, list[Interval]] = defaultdict(list)
    for seed in range(records):
        for each in INTERVALS[type(setting)](setting, seed):  # type: ignore[operator]
            found[each.name].append(each)
    shares = {}
    for name, some in found.items():
        free = [each for each in some if not each.given]
        counted = free or some
        shares[name] = Share(float(np.mean([each.holds for each in counted])), len(counted), not free)
    return shares


def main() -> int:
    """Print the coverages; the status is 1 if an unconditional one is below 92 %."""
    records = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    groups = {"motor": SETTINGS, "small": MISFITS, "regression": EQUATIONS, "joint": JOINTS}
    every = {f"{group}, {name}": setting for group, settings in groups.items() for name, setting in settings.items()}
    status = 0
    for name, setting in every.items():
        if sys.argv[2:] and name not in sys.argv[2:] and name.partition(",")[0] not in sys.argv[2:]:
            continue
        print(name, flush=True)
        for parameter, share in shares(setting, records).items():
            mark = (
                "  given what may be wrong" * share.given + "  BELOW 92 %" * share.wrong + "  above 98 %" * share.wide
            )
            print(f"  {parameter:30} {100 * share.covered:5.1f} ± {100 * share.margin:.1f} % of {share.count}{mark}")
            status |= share.wrong
    return int(status)


if __name__ == "__main__":
    raise SystemExit(main())
