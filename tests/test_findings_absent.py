"""For every code of a finding, a result in which it could stand and does not.

Most codes are absent from what three ordinary identifications find, of a regression, a cascade and a motor; those that
every such result has, or that other work makes, are absent in a test of their own, which `ELSEWHERE` names.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from math import exp
from pathlib import Path

import numpy as np
import pytest

import emsid
from emsid.wording import CATALOGUE, Severity
from source_tree import nodes_of

TESTS = Path(__file__).parent
STUDY = "test_study.py::"
QUIET = "test_live.py::test_a_source_without_faults_gives_no_finding"

ELSEWHERE = {
    "change-detected": QUIET,
    "source-gap": QUIET,
    "nothing-excites": QUIET,
    "samples-not-tracked": QUIET,
    "source-disconnected": QUIET,
    "source-silent": QUIET,
    "lines-not-used": QUIET,
    "log-not-written": QUIET,
    "tracking-errors-coloured": QUIET,
    "motor-not-at-zero": "test_live_board.py::test_a_run_over_a_socket_ends_at_zero_volts",
    "model-recommended": "test_verdict.py::test_a_model_without_use_is_unusable_and_not_recommended",
    "residual-independent-of-input": (
        "test_conclusions.py::test_a_residual_depends_on_the_input_where_the_model_misses_something"
    ),
    "study-even-terms": f"{STUDY}test_even_terms_are_named_where_the_motor_is_the_same_in_both_directions",
    "study-model-failed": f"{STUDY}test_a_model_that_cannot_be_fitted_is_named",
    "study-rank-deficient": f"{STUDY}test_a_regression_that_the_data_do_not_determine_is_named",
    "study-excitation": f"{STUDY}test_without_inputs_nothing_is_said_about_them",
    "study-load-friction": f"{STUDY}test_a_rotor_without_friction_has_no_curve_of_load_friction",
    "study-many-inputs": f"{STUDY}test_a_recorded_survey_says_so_and_speaks_of_its_own_motor",
    "study-paper-ratios": f"{STUDY}test_records_of_the_user_take_the_place_of_the_bench",
    "study-survey-recorded": f"{STUDY}test_a_recorded_survey_says_so_and_speaks_of_its_own_motor",
    "study-two-masses": f"{STUDY}test_a_recorded_survey_says_so_and_speaks_of_its_own_motor",
    "study-virtual-bench": f"{STUDY}test_records_of_the_user_take_the_place_of_the_bench",
}
"""The test that shows a code absent."""

ALWAYS = {
    "free-run-error",  # of every model that does not diverge
    "next-experiment",  # one for every identification
    "study-best-model",
    "study-largest-ratio",
    "study-noise-free",
    "study-one-step",
    "study-own-simulator",
    "study-recursive-and-batch",
    "study-what-decides",
}
"""What every identification, or every study, has: one of them without it would be a defect."""


def drive(seed: int, edge: float = 0.0, samples: int = 1500) -> emsid.Record:
    """A first-order drive, behind a dead zone of this half width, with white noise that the model does not see."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-3, 3, samples // 10), 10)
    v = np.sign(u) * np.maximum(np.abs(u) - edge, 0)
    a, y = exp(-0.05), np.zeros(samples)
    for k in range(1, samples):
        y[k] = a * y[k - 1] + (1 - a) * 3.0 * v[k - 1]
    noisy = y + 0.01 * rng.standard_normal(samples)
    return emsid.Record(u, noisy, 0.01, input_units=("V",), output_units=("rad/s",), name=f"bench {seed}")


def motor(seed: int) -> emsid.Record:
    """A rigid motor, with its current."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-10, 10, 60), 20)
    plant = emsid.plants.rigid_motor()
    signals = (emsid.plants.Signal.SPEED, emsid.plants.Signal.CURRENT)
    y = plant.simulate(u[:, None], 0.005, np.zeros(plant.states), signals)
    y = y + 1e-3 * np.std(y, axis=0) * rng.standard_normal(y.shape)
    return emsid.Record(u, y, 0.005, input_units=("V",), output_units=("rad/s", "A"), name=f"motor {seed}")


@pytest.fixture(scope="module")
def present() -> dict[str, set[str]]:
    """The codes of all findings on every result."""
    regression = emsid.identify(drive(1), drive(2), models="arx", options=emsid.Options(na=1, nb=1, nk=1))
    blocks = emsid.Options(static="dead-zone", orders=(1,), nk=1)
    cascade = emsid.identify(drive(3, 0.5), drive(4, 0.5), models="hammerstein", options=blocks)
    known = emsid.Options(free=("R", "motor_constant", "rotor_inertia", "rotor_friction.coulomb"))
    plant = emsid.identify(motor(5), motor(6), models="rigid-motor", options=known)
    found = {}
    for name, result in (("regression", regression), ("cascade", cascade), ("plant", plant)):
        about_models = (*result.model_verdicts, *result.recommendation)
        findings = (*result.findings, *result.verdicts, *about_models, *result.next_steps, *result.chosen.findings)
        found[name] = {finding.code for finding in findings}
    return found


@pytest.mark.parametrize("code", sorted(set(CATALOGUE) - set(ELSEWHERE) - ALWAYS))
def test_a_code_is_absent_where_nothing_is_wrong(present: dict[str, set[str]], code: str) -> None:
    without = [name for name, codes in present.items() if code not in codes]
    assert without, f"every result has {code}"


def test_results_without_a_fault_have_no_problem(present: dict[str, set[str]]) -> None:
    problems = {code for code, entry in CATALOGUE.items() if entry.severity is Severity.PROBLEM}
    assert not problems & set.union(*present.values())


def texts(path: Path, test: str) -> Iterator[str]:
    """Every text in a test."""
    for node in nodes_of(path):
        if isinstance(node, ast.FunctionDef) and node.name == test:
            yield from (n.value for n in ast.walk(node) if isinstance(n, ast.Constant) and isinstance(n.value, str))


@pytest.mark.parametrize("code", ELSEWHERE)
def test_the_test_that_shows_a_code_absent_is_there(code: str) -> None:
    file, _, test = ELSEWHERE[code].partition("::")
    assert code in set(texts(TESTS / file, test))


def test_the_table_names_codes_that_there_are() -> None:
    assert (set(ELSEWHERE) | ALWAYS) <= set(CATALOGUE)
