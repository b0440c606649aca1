"""The systems of the baseline are complete, reproducible, and leave the true model the error that they say."""

import json
import sys
from dataclasses import asdict, replace
from importlib import import_module
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from independent.supported import PLANTS
from independent.systems import MORE, OF_PLANTS, SYSTEMS, Disturbed, Realisations, arx, equation, inner_noise

FAMILIES = {"motors", "axes", "shafts", "joints", "linear", "regressions", "cascades", "feedback"}
ONE = np.ones(8)


def test_there_are_forty_systems_of_all_families():
    assert len(SYSTEMS) >= 40
    assert {family for family, _ in SYSTEMS.values()} == FAMILIES
    assert sorted(name for names in OF_PLANTS.values() for name in names) == sorted(PLANTS)


@pytest.mark.parametrize("name", ["averaged speed", "ARMAX", "bilinear", "noise inside", "overflow"])
def test_a_seed_gives_the_same_records_and_noise_is_small(name):
    system = MORE[name][1]
    first, again, other = system.pair(3), system.pair(3), system.pair(4)
    np.testing.assert_array_equal(first.fitted.output, again.fitted.output)
    assert np.any(first.fitted.output != other.fitted.output)
    assert 0 < first.noise < 0.1 * np.std(first.unseen.output)
    centre = first.fitted.input[0]
    sizes = [np.abs(each.input - centre).max() for each in first[:2]]
    assert 0.3 * sizes[0] < sizes[1] < 0.81 * sizes[0]


def test_the_truth_of_a_difference_equation_leaves_its_noise():
    case = MORE["ARX"][1]
    assert isinstance(case, Disturbed)
    pair = case.pair(0)
    errors = [case.noise * np.std(lfilter([1.0], [1.0, -1.5, 0.56], np.random.default_rng(k).standard_normal(990)))
              for k in range(20)]  # fmt: skip
    assert min(errors) < pair.noise < max(errors)


def test_realisations_are_together_and_judged_without_the_noise_inside():
    pair = Realisations(3, 512).pair(1)
    assert [len(segment) for segment in pair.fitted.segments] == [512] * 3
    assert len(pair.unseen) == 2 * 512
    assert pair.noise == pytest.approx(0.01 * np.std(pair.fitted.output), rel=0.1)


def test_equations_are_those_of_their_names():
    u, e = np.random.default_rng(0).standard_normal((2, 300))
    y = arx(u, e, ONE)
    expected = [1.5 * y[t - 1] - 0.56 * y[t - 2] + 0.04 * u[t - 1] + 0.02 * u[t - 2] + e[t] for t in range(2, 300)]
    np.testing.assert_allclose(y[2:], expected, atol=1e-9)
    z = equation(lambda y, u, t: 1.5 * y[t - 1] - 0.56 * y[t - 2] + 0.04 * u[t - 1] + 0.02 * u[t - 2])(u, e, ONE)
    np.testing.assert_allclose(z, y, atol=1e-9)
    assert np.abs(inner_noise(50 * u, e, ONE)).max() < 2  # the saturation behind the noise


# --- the bench -------------------------------------------------------------------------------------------------------


@pytest.fixture
def baseline(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "bench"))
    import baseline

    yield baseline
    for name in ("ablation", "baseline", "recordings", "arguments"):
        sys.modules.pop(name, None)


def test_a_file_that_was_cut_off_is_continued_and_compared(baseline, tmp_path, capsys, monkeypatch):
    line = baseline.Line("motors", "motor", 0, "arx", 4, 2.0, 1.2, "arx", 1.2, "model-supported", ("few-levels",), 3.0)
    wrong = replace(line, seed=1, ratio=1.31)
    diverges = replace(line, seed=2, error=None, ratio=None)
    assert [each.wrong for each in (line, wrong, diverges, replace(diverges, verdict="model-limited"))] == [
        False, True, True, False,
    ]  # fmt: skip
    assert not replace(wrong, family=baseline.RECORDINGS).wrong
    texts = [json.dumps(asdict(each)) for each in (line, wrong, diverges)]
    path = tmp_path / "before.json"
    path.write_text("\n".join([*texts, texts[0][:40]]), "utf-8")
    assert baseline.read(path) == [line, wrong, diverges]
    for each in (diverges, line):
        baseline.write(each, path)
    assert baseline.read(path) == [line, wrong, diverges, diverges, line]
    new_file = tmp_path / "after.json"
    baseline.write(line, new_file)
    assert new_file.read_text("utf-8") == texts[0] + "\n"
    monkeypatch.setattr("sys.argv", ["baseline.py", "--only", ": motor", "--out", str(path), "--against", str(path)])
    baseline.main()
    assert "median 1.000, 90 % quantile 1.000" in capsys.readouterr().out
    better, new = replace(line, error=1.0), replace(wrong, verdict="model-limited")
    baseline.compared([better, wrong, diverges], [line, new, diverges])
    said = capsys.readouterr().out
    assert "median 1.000" in said
    assert "supported that were not: motor; newly wrong: motor" in said


def test_the_distribution_counts_what_diverges_as_worst(baseline):
    line = baseline.Line("motors", "motor", 0, "arx", 4, 2.0, 1.2, "arx", 1.2, "model-supported", (), 3.0)
    lines = [replace(line, seed=k) for k in range(9)]
    lines += [replace(line, seed=9, error=None, ratio=None)]
    said = "median 1.200, 90 % quantile 1.200, 9 of 10 within 1.3 times the truth; 10 called supported, 1 of them wrong"
    assert baseline.distribution(lines) == f"{said}; 30 s of CPU"


def test_every_mechanism_is_switched_off_and_on_again(baseline):
    import ablation

    for mechanism, replaced in ablation.MECHANISMS.items():
        for module, path, other in replaced:
            found = attrgetter(path)
            before = found(import_module(module))
            with ablation.without(mechanism):
                assert found(import_module(module)) is other
            assert found(import_module(module)) is before
    line = baseline.Line("motors", "motor", 0, "arx", 4, 2.0, 1.2, "arx", 1.2, "model-supported", (), 3.0)
    undisturbed = {replace(line, seed=k).key: replace(line, seed=k) for k in range(3)}
    lines = [replace(line, error=2.01), replace(line, seed=1, error=3.0, ratio=1.8), replace(line, seed=2, error=None)]
    said = ablation.row("exchange of moves", lines, undisturbed)
    assert said == ["exchange of moves", "1.200", "1.200", "2 of 3", "3", "1", "2", "1.005", "inf", "9"]
