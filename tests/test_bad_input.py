"""Data that nothing, or little, can be identified from: a clear message for each."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import emsid
from emsid import DataError, Options


@pytest.fixture(autouse=True)
def _no_warnings() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def record(samples: int, seed: int = 0, name: str = "log", sign_only: bool = False) -> emsid.Record:
    """A first-order drive, with steps of the input."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1, 1, samples // 4 + 1), 4)[:samples]
    u = np.sign(u) if sign_only else u
    y = np.zeros(samples)
    for k in range(1, samples):
        y[k] = 0.8 * y[k - 1] + u[k - 1]
    return emsid.Record(u, y + 0.01 * rng.standard_normal(samples), 0.01, name=name)


ONE = Options(na=1, nb=1, nk=1)


def codes(result: emsid.Identification) -> set[str]:
    return {finding.code for finding in (*result.findings, *result.recommendation)}


@pytest.mark.parametrize(
    ("samples", "options", "said"),
    [
        (19, ONE, "19 samples are too few to fit a model and to test it; record at least 20"),
        (20, Options(na=5, nb=5, nk=3), "usable samples for the 10 parameters of arx; record longer"),
    ],
)
def test_too_little_for_a_part_that_is_kept_unseen(samples: int, options: Options, said: str) -> None:
    with pytest.raises(emsid.EmsidError, match=said):
        emsid.identify(record(samples), models="arx", options=options)


def test_a_short_part_begins_with_the_samples_before_it() -> None:
    """The seven unseen samples are fewer than the nine that start the model, and all of them count."""
    found = emsid.identify(record(24), models="arx", options=Options(na=1, nb=1, nk=9))
    assert found.on_unseen.best.row.samples == len(found.unseen) == 7


def test_few_unseen_samples_are_named() -> None:
    few = emsid.identify(record(40), models="arx", options=ONE)
    (found,) = (finding for finding in few.findings if finding.code == "few-unseen-samples")
    assert found.data == {"samples": 12, "needed": 50}
    assert few.recommendation[1].data["kind"] == "longer"
    assert "few-unseen-samples" not in codes(emsid.identify(record(200), models="arx", options=ONE))


def test_samples_of_all_parts_that_are_left_out_in_turn_are_enough_to_rank_models() -> None:
    several = emsid.identify(record(100), models="arx,output-error", options=ONE)
    assert several.on_unseen.best.row.samples < 50
    assert "few-unseen-samples" not in codes(several)


def test_a_fraction_that_leaves_hardly_anything_to_fit() -> None:
    with pytest.raises(
        DataError, match=r"log, unseen part, of 599 samples, leaves 1 sample to fit; keep a smaller part"
    ):
        emsid.identify(record(600), unseen=0.999, models="arx", options=ONE)


def test_a_model_whose_residual_cannot_be_tested_is_not_called_supported() -> None:
    known, other = record(600), record(600, seed=1)
    settling = np.zeros((60, 1))
    settling[:, 0] = 4 * 0.8 ** np.arange(60)  # from a start in motion, without an input
    for unseen, untested in ((emsid.Record(0 * settling, settling, 0.01, name="coasts"), True), (other, False)):
        (verdict,) = emsid.identify(known, unseen, models="arx", options=ONE).model_verdicts
        assert ("residual-untested" in {each["code"] for each in verdict.data["reasons"]}) == untested


def test_values_too_small_to_compute_with() -> None:
    usual = record(600)
    with pytest.raises(DataError, match="cannot be computed with; scale it"):
        emsid.identify(emsid.Record(1e-300 * usual.input, 1e-300 * usual.output, 0.01), models="arx", options=ONE)


def test_the_same_record_for_both_and_overlapping_ones() -> None:
    whole = record(400)
    for known, unseen in ((whole, whole), (whole[:250], whole[200:])):
        result = emsid.identify(known, unseen, models="arx", options=ONE)
        assert "data-not-unseen" in codes(result)
        assert {row.data_label for row in result.rows} == {"used in fit"}
        assert result.recommendation[0].data["seen"]
        assert result.recommendation[1].data["kind"] == "other-input"
    apart = emsid.identify(whole[:200], whole[200:], models="arx", options=ONE)
    assert "data-not-unseen" not in codes(apart)


def test_a_record_that_is_all_standstill() -> None:
    u, rest = record(300).input, np.zeros(300)
    with pytest.raises(DataError, match="is constant at 0, so nothing can be identified from it"):
        emsid.identify(emsid.Record(u, rest, 0.01))
    noise = 1e-3 * np.random.default_rng(1).standard_normal(300)
    result = emsid.identify(emsid.Record(u, noise, 0.01), models="arx", options=ONE)
    assert {"no-response", "output-noise-only", "no-better-than-mean", "no-model-recommended"} <= codes(result)
    unseen = emsid.identify(record(300), emsid.Record(u, rest, 0.01, name="rest"), models="arx", options=ONE)
    assert unseen.model_verdicts[0].data["reasons"][0]["code"] == "output-at-rest"


def test_a_dictionary_whose_terms_the_data_do_not_distinguish() -> None:
    dictionary = emsid.polynomial_narx(1, 1, 3)  # u³ is u where the input is ±1
    (found,) = emsid.select_terms(dictionary, record(300, sign_only=True)).findings
    assert found.code == "dictionary-rank-deficient"
    assert found.data["rank"] < found.data["terms"] == len(dictionary)
    assert emsid.select_terms(dictionary, record(300)).findings == ()
    result = emsid.identify(
        record(300, sign_only=True), models="polynomial-narx", options=Options(na=1, nb=1, nk=1, degree=2)
    )
    assert "dictionary-rank-deficient" in codes(result)


@pytest.mark.parametrize(
    ("name", "options", "said"),
    [
        ("still", (), "output 'y' is constant at 0, so nothing can be identified from it; record while it changes"),
        ("few", (), "15 samples are too few to fit a model and to test it; record at least 20 (--rows)"),
        ("log", ("--unseen", "log.csv"), "log.csv: give a fraction between 0 and 1; name files of unseen data with"),
    ],
)
def test_the_command_line_says_it_in_one_sentence(
    name: str,
    options: tuple[str, ...],
    said: str,
    tmp_path: Path,
    command: Callable[..., int],
    capsys: pytest.CaptureFixture[str],
) -> None:
    known = record(300)
    columns = {"still": 0 * known.output, "few": known.output[:15], "log": known.output}[name]
    table = np.column_stack([known.input[: len(columns)], columns])
    np.savetxt(tmp_path / f"{name}.csv", table, delimiter=",", header="u,y", comments="")
    words = ("-u", "u", "-y", "y", "--dt", "0.01", "--out", tmp_path / "out")
    assert command("identify", tmp_path / f"{name}.csv", *words, *options) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
