"""Every sentence about a result, pinned in one file; elsewhere tests assert the code of a finding and its data.

To add a code: register its words in `emsid.wording`, add an example to `EXAMPLES`, and write the file of sentences
again: ``python tests/test_wording.py``. Then read its difference.
"""

from __future__ import annotations

import ast
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import emsid
from emsid.cli.options import option
from emsid.findings import Finding
from emsid.wording import CATALOGUE, Severity, sentence, severity
from source_tree import nodes_of

HOME = Path(emsid.__file__).parent
TESTS = Path(__file__).parent
SENTENCES = TESTS / "wording" / "sentences.txt"

SO_FAR = {"steps": 12, "offset": 3.4}
RESIDUAL = {"model": "arx", "lags": 25}
IDENTIFIABLE = {
    "model": "rigid-motor",
    "channels": ["voltage", "speed"],
    "parameters": ["resistance", "motor_constant"],
    "current_missing": True,
}
ONE_OUTPUT = [{"name": "speed", "unit": "rad/s", "rmse": 1.25, "fit_percent": 92.3}]

LOAD_FRICTION = {"mse": 0.012, "share": 0.001, "paper": 0.01, "at_most": 0.1, "errors": [0.106, 0.107], "difference": 1}
PAPER_RATIOS = [
    {"data": "identification", "paper": 22.02, "free_run": 0.985, "one_step": 0.999},
    {"data": "unseen", "paper": 557.2, "free_run": 0.982, "one_step": 0.998},
]
MANY_INPUTS = [
    {"model": "paper-narx", "parameters": 10, "inputs": 30, "median": 0.889, "lowest": 0.568, "highest": 1.1},
    {"model": "rigid-motor", "parameters": 7, "inputs": 30, "median": 2650.0, "lowest": 1050.0, "highest": 20400.0},
]
WHAT_DECIDES = {
    "even": {"motors": 6, "lowest": 1.12, "highest": 15.1},
    "odd": {"motors": 4, "lowest": 0.988, "highest": 0.999},
    "always": {"friction-narx": 207.0, "rigid-motor": 948.0},
}
LARGEST = {
    "motors": 47,
    "usual": {"unseen": 19.7, "identification": 26.3},
    "largest": {"unseen": 1720.0, "reading": "nearly one sine"},
    "one_step": 1.07,
    "published": [22.02, 557.2],
}
TWO_MASSES = [
    {"record": "bench", "parameters": 10, "covered": 9, "worst": "inductance", "error": 0.5, "interval": 0.34},
    {"record": "simulator", "parameters": 10, "covered": 0, "worst": "inductance", "error": -0.1, "interval": 5e-5},
]
EXCITATION = {"study": "experiment", "order": 4, "parameters": 8, "condition": 3029.0, "crest_factor": 1.953}
RICHER = {"order": 16, "condition": 370.0, "crest_factor": 1.44, "errors": {"arx": [39.3, 53.4]}}
RECURSIVE = {
    "study": "simulation",
    "difference": 0.28,
    "forgetting": 1.0,
    "condition": 3.7e9,
    "covariance": 1e8,
    "ridge": -0.28,
}
LEAVES = {"block": 2, "at": 1.571, "value": -90.0, "low": -1.2, "high": 1.1}
TOO_LATE = {"delay": 3.6, "rise": 0.4, "samples": 360}
PAST = {"output": "speed", "input": "u", "lags": 51, "at_lag": 4, "limit": 3.9, "p_value": 0.0, "passed": False}
LIMITS = [
    {"code": "explains-little", "fit_percent": 42.0},
    {"code": "output-at-rest"},
    {"code": "depends-on-past-inputs", "share": 0.12, **PAST, "largest": 12.3},
    {"code": "depends-on-nonlinear-term", "share": 0.12, **PAST, "largest": -8.0, "term": "u³", "kind": "odd"},
    {"code": "one-step-errors-coloured", "output": "speed", "largest": 0.6, "at_lag": 1},
    {"code": "pieces-differ", "kind": "gain", "output": "speed", "unit": "rad/s", "spread": 0.08, "share": 0.4},
    {"code": "pieces-differ", "kind": "delay", "output": "speed", "unit": "rad/s", "spread": 0.02, "share": 0.4},
    {"code": "pieces-differ", "kind": "level", "output": "speed", "unit": "rad/s", "spread": 2.0, "share": 0.4},
    {"code": "larger-on-unseen", "ratio": 2.8},
    {"code": "error-in-one-stretch", "share": 0.7, "first": 3000, "last": 3200},
    {"code": "search-not-finished", "ending": "stalled"},
]
RECOMMENDED = {
    "fit_percent": 97.3,
    "models": 9,
    "folds": 1,
    "seen": False,
    "verdict": "model-supported",
    "reasons": [],
    "tests_failed": 0,
}

LOAD = {"parameters": ["offset"], "deviation": 0.21, "mean": None, "walks": True, "unit": "N", "trusted": 1.2}
EXAMPLES: tuple[Finding, ...] = (
    # linear estimation
    Finding("rank-deficient", data={"rank": 2, "parameters": 3, "zero": ["max(u(t-1)-5, 0)"], "alike": []}),
    Finding(
        "rank-deficient",
        data={
            "rank": 2,
            "parameters": 4,
            "zero": ["u(t-3)", "u(t-4)"],
            "alike": [{"regressor": "abs(u(t-1))", "like": ["u(t-1)"]}],
        },
    ),
    Finding("few-samples", data={"samples": 16.0, "parameters": 8}),
    Finding("forgetting-limited", data={"samples": 1200, "parameters": ["b1", "b2"]}),
    Finding("forgetting-limited", data={"samples": 3, "parameters": []}),
    Finding("regression-biased", data={"lags": 25, "p_value": 3e-12, "largest": -0.34, "lag": 1}),
    Finding("intervals-allow-for-colour", data={"lags": 25, "p_value": 3e-12, "largest": -0.34, "lag": 1}),
    Finding(
        "residual-depends-on-term",
        "speed",
        {"model": "arx", "term": "voltage³", "kind": "odd", "largest": -7.2, "at_lag": 4, "limit": 3.9},
    ),
    Finding(
        "residual-depends-on-term",
        "speed",
        {"model": "arx", "term": "a·b", "kind": "product", "largest": 7.2, "at_lag": 4, "limit": 3.9},
    ),
    # searches
    Finding("search-stalled", data=SO_FAR),
    Finding("search-stalled", data={**SO_FAR, "starts": 7, "agreeing": 2}),
    Finding("minimum-not-smooth", data={"starts": 7, "agreeing": 5}),
    Finding("searches-agreeing", data={"searches": 3, "agreeing": 2, "compared": 53}),
    Finding("searches-agreeing", data={"searches": 1, "agreeing": 1, "compared": 53}),
    Finding("searches-agreeing", data={"searches": 1, "agreeing": 1, "compared": 1}),
    Finding("alternatives-fit-as-well", data={"instead": ["inductance", "sensor.lag"], "of": "drive.delay"}),
    Finding("alternatives-fit-as-well", data={"instead": ["drive.delay"], "of": None}),
    Finding("parameter-drifts", "offset", {"halves": [-3.247, -3.532], "unit": "N"}),
    Finding(
        "parameters-by-record",
        "rigid-motor",
        {"parameters": ["rotor_inertia"], "records": ["a", "b", "c"], "typical": [2.5e-4], "units": ["kg*m^2"]},
    ),
    Finding(
        "parameters-by-record",
        "motor",
        {
            "parameters": ["load_inertia", "load_torque"],
            "records": ["a", "b"],
            "typical": [2.5e-4, -0.01],
            "units": ["kg*m^2", "N*m"],
        },
    ),
    Finding(
        "parameters-reestimated",
        "disc.csv",
        {"parameters": ["rotor_inertia"], "samples": 225, "rest": 525, "before": 81.23, "after": 97.5},
    ),
    Finding("single-record", "bench.csv", {"parameters": ["rotor_inertia"]}),
    Finding("single-record", "bench.csv", {"parameters": ["rotor_inertia", "load_torque"]}),
    Finding("steps-used-up", data=SO_FAR | {"steps": 1}),
    Finding("time-used-up", data=SO_FAR | {"offset": None}),
    Finding("search-cancelled", data=SO_FAR),
    Finding("cost-hardly-falls", data=SO_FAR | {"last_steps": 15, "least_saving": 0.01}),
    Finding("parameter-at-bound", "inductance", {"side": "lower", "bound": 0.0}),
    Finding(
        "parameter-at-bound",
        "voltage_dead_zone.half_width",
        {
            "side": "lower",
            "bound": 0.0,
            "because": "inseparable",
            "others": ["rotor_friction.coulomb"],
            "one_way": True,
        },
    ),
    Finding("parameters-undetermined", data={"without_effect": ["f.m_l"], "inseparable": [["R", "K"]]}),
    # cascades
    Finding("choices-cut-short", "wiener", {"cancelled": True}),
    Finding("dead-time-at-input", "wiener", {"model": "wiener", "delay": 1, "moved": 1, "filters": 1}),
    Finding(
        "dead-time-at-input",
        "wiener-hammerstein",
        {"model": "wiener-hammerstein", "delay": 2, "moved": 1, "filters": 2},
    ),
    Finding("periods-averaged", "wiener", {"period": 4096, "periods": 6, "records": 2, "noise": 0.01}),
    Finding("periods-averaged", "wiener", {"period": 4096, "periods": 1, "records": 1, "noise": None}),
    Finding("process-noise", "wiener", {"block": 2, "spread": 0.09, "share": 0.15, "corrected": True}),
    Finding("process-noise", "wiener", {"block": 2, "spread": 0.09, "share": 0.15, "corrected": False}),
    Finding("zero-cancels-pole", data={"model": "wiener", "block": 1, "pole": [0.9, 0.0]}),
    Finding("zero-cancels-pole", data={"model": "wiener", "block": 1, "pole": [0.9, 0.1]}),
    Finding("dead-zone-side-unseen", data={"block": 2, "side": "left", "parameters": ["b_l", "m_l"], "share": 0.001}),
    Finding("dead-zone-unseen", data={"block": 2, "share": 0.001}),
    Finding("limit-unseen", data={"block": 2, "side": "high", "share": 0.0}),
    Finding("knots-without-data", data={"block": 2, "knots": [-3.0, 3.0]}),
    Finding("too-few-knots", "wiener", {"block": 2, "saved": 0.587}),
    Finding("map-is-straight", data={"block": 2}),
    Finding("parameters-without-interval", data={"parameters": ["f.b_r", "f.m_r"]}),
    # plants
    Finding("fitted-to-all-data", "log.csv", {"model": "feedback", "samples": 1024, "of": 717, "searched": False}),
    Finding("fitted-to-all-data", "log.csv", {"model": "feedback", "samples": 1024, "of": 717, "searched": True}),
    Finding("fitted-to-excerpt", "log.csv", {"samples": 20_000, "of": 350_000, "finished": "rigid-motor"}),
    Finding("fitted-to-excerpt", "log.csv", {"samples": 20_000, "of": 350_000, "finished": ""}),
    Finding("input-taken-as-constant", "force", {"between": "band-limited", "ratio": 41.5}),
    Finding("input-between-samples", "voltage", {"straight": 1, "held": 0}),
    Finding("input-between-samples", "voltage", {"straight": 2, "held": 1}),
    Finding("speed-is-a-mean", "speed"),
    Finding("friction-fades-as-gaussian", "rigid-motor"),
    Finding("unit-assumed", "rigid-motor", {"channel": "y", "signal": "speed", "unit": "rad/s"}),
    Finding("command-unit-assumed", "rigid-motor", {"channel": "u", "unit": "volts"}),
    Finding("command-may-be-duty", "rigid-motor", {"channel": "PWM", "full": 255.0}),
    Finding("codes-without-bridge", "rigid-motor", {"codes": [999.0], "nothing": "torque"}),
    Finding("no-shaft-seen", "motor", {"model": "motor", "simpler": "rigid-motor"}),
    Finding("no-shaft-needed", "motor", {"model": "motor", "simpler": "rigid-motor", "ratio": 0.0834}),
    Finding("nothing-identifiable", "rigid-motor", {"model": "rigid-motor", "channels": ["voltage", "speed"]}),
    Finding(
        "not-identifiable",
        "rigid-motor",
        IDENTIFIABLE | {"combinations": ["K/R", "K²/R"], "kept": [["resistance", 2.0, "ohm"]]},
    ),
    Finding(
        "not-identifiable",
        "rigid-motor",
        IDENTIFIABLE | {"parameters": ["drive.supply"], "combinations": [], "kept": [["drive.supply", 12.0, "V"]]},
    ),
    Finding("weakly-identified", "rigid-motor", IDENTIFIABLE | {"combinations": ["K/R"]}),
    Finding("weakly-identified", "rigid-motor", IDENTIFIABLE | {"parameters": ["drive.delay"], "combinations": []}),
    Finding("intervals-include-zero", "rigid-motor", {"model": "rigid-motor", "parameters": ["sensor.lag"]}),
    Finding("intervals-include-zero", "rigid-motor", {"model": "rigid-motor", "parameters": ["a", "b"]}),
    Finding("choice-interrupted", "rigid-motor", {"model": "rigid-motor"}),
    Finding("load-drifts", "linear-axis", LOAD | {"parameters": []}),
    Finding("load-drifts", "linear-axis", LOAD),
    Finding("load-drifts", "linear-axis", LOAD | {"walks": False}),
    Finding("load-drifts", "linear-axis", LOAD | {"mean": 0.12}),
    Finding(
        "load-drifts", "linear-axis", LOAD | {"parameters": ["friction.coulomb.forward", "friction.coulomb.backward"]}
    ),
    Finding("probably-another-system", "rigid-motor", {"left": 0.76, "linear": 0.098}),
    # what was asked for of an identification
    Finding("option-not-used", "fixed", {"models": ["arx", "wiener"]}),
    Finding("knots-not-used", "hammerstein", {"model": "hammerstein", "family": "dead-zone"}),
    Finding("code-never-occurs", "PWM", {"value": 999.0}),
    Finding("codes-taken-as-commands", "arx", {"model": "arx", "values": [999.0]}),
    Finding("codes-taken-as-commands", "arx", {"model": "arx", "values": [999.0, 1000.0]}),
    Finding("datasheet-not-used", "linear-axis", {"model": "linear-axis"}),
    Finding(
        "built-in-values-kept",
        "linear-axis",
        {
            "model": "linear-axis",
            "parameters": [
                {"name": "viscous_friction", "value": 1.0, "unit": "N*s/m"},
                {"name": "friction.coulomb", "value": 0.1, "unit": "N"},
            ],
        },
    ),
    Finding("profile-failed", "drive.delay", {"model": "rigid-motor", "reason": "drive.delay was not estimated"}),
    *(
        Finding(
            "profile-interval",
            "motor_constant",
            {"model": "rigid-motor", "level": 0.95, "low": low, "high": high, "unit": "N*m/A"},
        )
        for low, high in ((0.049, 0.051), (0.049, None), (None, 0.051), (None, None))
    ),
    Finding("model-failed", "wiener", {"model": "wiener", "reason": "the input is too short", "arguments": ["orders"]}),
    Finding("model-out-of-time", "wiener", {"model": "wiener"}),
    Finding("quick-look", "log.csv", {"without": ["wiener-hammerstein", "rigid-motor"]}),
    Finding("interrupted", data={"missing": ["wiener", "motor"]}),
    Finding("interrupted", data={"missing": []}),
    # live
    Finding(
        "change-detected",
        "speed",
        {"time": 30.08, "since": 30.02, "delay": 0.06, "what": "level", "false_alarm": 3600.0},
    ),
    Finding(
        "change-detected",
        "speed",
        {"time": 30.08, "since": 30.02, "delay": 0.06, "what": "spread", "false_alarm": None},
    ),
    *(
        Finding("source-gap", "socket://board:7000", {"time": 12.5, "samples": samples, "cause": cause})
        for samples, cause in ((7, "lost"), (1, "unusable"), (None, "backwards"), (500, "disconnected"), (9, "skipped"))
    ),
    Finding("samples-not-tracked", "socket://board:7000", {"samples": 1200}),
    Finding("source-disconnected", "serial:///dev/ttyACM0"),
    Finding("source-silent", "serial:///dev/ttyACM0", {"seconds": 5.2}),
    Finding("lines-not-used", "serial:///dev/ttyACM0", {"lines": 3, "not_finite": 0, "example": "1.2,x"}),
    Finding("lines-not-used", "serial:///dev/ttyACM0", {"lines": 3, "not_finite": 2, "example": "1.2,x"}),
    Finding("log-not-written", "out/log.txt", {"reason": "no space left on device", "bytes": 4096}),
    Finding("tracking-errors-coloured", data={"correlation": 0.62}),
    Finding("motor-not-at-zero", "serial:///dev/ttyACM0"),
    # how good it is, and on what
    Finding("data-not-unseen", "log.csv"),
    Finding("free-run-error", "arx", {"model": "arx", "seen": False, "outputs": ONE_OUTPUT}),
    Finding(
        "error-in-region",
        "speed",
        {"model": "arx", "region": "reversal", "rmse": 3.21, "others": 1.0, "unit": "rad/s", "samples": 812},
    ),
    Finding(
        "free-run-error",
        "arx",
        {"model": "arx", "seen": False, "outputs": ONE_OUTPUT, "chosen_among": 4, "apart": [1.31]},
    ),
    Finding(
        "free-run-error",
        "arx",
        {"model": "arx", "seen": False, "outputs": ONE_OUTPUT, "chosen_among": 2, "apart": None},
    ),
    Finding(
        "free-run-error",
        "arx",
        {"model": "arx", "seen": False, "outputs": ONE_OUTPUT, "chosen_among": 4, "chosen_on": 1500},
    ),
    Finding(
        "free-run-error",
        "rigid-motor",
        {
            "model": "rigid-motor",
            "seen": True,
            "outputs": [*ONE_OUTPUT, {"name": "current", "unit": "A", "rmse": 0.02, "fit_percent": None}],
        },
    ),
    Finding("no-better-than-mean", "speed", {"seen": False}),
    Finding("worse-than-mean", "b.csv"),
    Finding("free-run-diverged", "arx", {"model": "arx", "sample": 123, "seen": False}),
    Finding("one-step-error-smaller", "arx", {"model": "arx", "ratio": 1234.5}),
    Finding("input-constant", "PWM", {"inputs": [{"name": "PWM", "level": 2.0}], "seen": False}),
    Finding(
        "input-beyond-range",
        "PWM",
        {"low": -200.0, "high": 200.0, "fitted_low": -100.0, "fitted_high": 100.0, "seen": False},
    ),
    *(
        Finding(
            "records-differ",
            "speed",
            {
                "model": "arx",
                "kind": kind,
                "unit": "rad/s",
                "share": 0.62,
                "records": [{"name": "a.csv", "value": first}, {"name": "b.csv", "value": second}],
            },
        )
        for kind, first, second in (("delay", -0.002, 0.003), ("gain", 0.05, -0.04), ("level", -0.2, 0.1))
    ),
    Finding(
        "channels-differ",
        "b.csv",
        {
            "what": "inputs",
            "identified_with": [{"name": "voltage", "unit": "V"}],
            "channels": [{"name": "speed", "unit": ""}],
        },
    ),
    Finding("sample-time-differs", "b.csv", {"identified_with": 0.01, "dt": 0.02}),
    Finding("residual-white", "speed", RESIDUAL | {"largest": 0.03, "lag": 3, "p_value": 0.4}),
    Finding("residual-coloured", "speed", RESIDUAL | {"largest": 0.61, "lag": 1, "p_value": 0.0}),
    Finding("residual-independent-of-input", "arx", {"model": "arx", "output": "speed", "share": 0.004}),
    Finding("residual-depends-on-input", "arx", {"model": "arx", "output": "speed", "share": 0.42}),
    Finding("residual-not-tested", "arx", {"model": "arx", "output": "speed"}),
    Finding(
        "record-shifted",
        "late.csv",
        {"output": "speed", "delay": 0.0094, "samples": 0.47, "rmse": 11.7, "shifted": 4.33, "unit": "deg/s"},
    ),
    Finding("next-check-data", "log.csv", {"fit_percent": 12.0}),
    Finding("next-reduce-noise", "log.csv", {"fit_percent": 28.3}),
    Finding("next-physical-model", "arx"),
    Finding("dictionary-rank-deficient", data={"rank": 25, "terms": 35}),
    Finding("intervals-by-bootstrap", "armax", {"model": "armax", "count": 199, "pieces": 30, "samples": 1200}),
    Finding(
        "no-bootstrap",
        "armax",
        {"model": "armax", "problem": "armax: the records make 3 pieces, but a bootstrap needs 6"},
    ),
    Finding("few-unseen-samples", "log.csv, unseen part", {"samples": 6, "needed": 50}),
    Finding("few-unseen-samples", "log.csv, unseen part", {"samples": 1, "needed": 50}),
    Finding("delay-from-data", "speed", {"input": "u", "delay": 36, "time": 0.036}),
    # the verdict on a model
    Finding("model-supported", "arx", {"model": "arx", "reasons": [], "tests": []}),
    Finding("model-supported", "arx", {"model": "arx", "reasons": [], "tests": [{"passed": False}]}),
    *(
        Finding("model-unusable", "arx", {"model": "arx", "reasons": [reason], "tests": []})
        for reason in ({"code": "diverges", "sample": 54}, {"code": "no-better-than-mean", "fit_percent": -37.2})
    ),
    Finding(
        "model-implausible",
        "wiener",
        {
            "model": "wiener",
            "reasons": [
                {"code": "map-turns-without-data", "model": "wiener", "block": 2, "at": 1.571},
                {"code": "map-leaves-range", **LEAVES},
                {"code": "knots-without-data", "block": 2, "knots": [365.0]},
                {"code": "zero-cancels-pole", "block": 1, "pole": [0.9, 0.0]},
                {"code": "faster-than-sampling", "pole": 0.1, "samples": 0.434},
                {"code": "delay-longer-than-rise", **TOO_LATE},
            ],
            "tests": [],
        },
    ),
    Finding("model-limited", "arx", {"model": "arx", "reasons": LIMITS, "tests": []}),
    *(
        Finding("model-recommended", "wiener", RECOMMENDED | more)
        for more in (
            {"models": 1, "seen": True, "fit_percent": None},
            {"tests_failed": 1},
            {"verdict": "model-limited", "reasons": LIMITS[:2]},
            {"verdict": "model-limited", "reasons": LIMITS},
            {"verdict": "model-implausible", "reasons": [{"code": "map-turns-without-data", "block": 2, "at": 1.571}]},
            {
                "instead_of": "hammerstein",
                "because": {"code": "map-leaves-range", **LEAVES},
                "ratio": 1.013,
                "parameters": [6, 6],
                "same_in": "noise",
            },
            *(
                {
                    "instead_of": "hammerstein",
                    "because": None,
                    "ratio": 1.013,
                    "parameters": [10, 57],
                    "folds": 4,
                    "same_in": same_in,
                }
                for same_in in ("noise", "practice", "all-data")
            ),
        )
    ),
    Finding(
        "no-model-recommended",
        "arx",
        RECOMMENDED | {"verdict": "model-unusable", "reasons": [{"code": "diverges", "sample": 54}]},
    ),
    *(
        Finding("next-experiment", "log.csv", {"kind": kind, **more})
        for kind, more in (
            ("longer", {"samples": 30, "needed": 50}),
            ("without-feedback", {}),
            ("more-levels", {"levels": 2}),
            ("larger-input", {}),
            ("faster-sampling", {"dt": 0.01}),
            ("finer-sensor", {}),
            ("both-directions", {"input": "u"}),
            ("fill-range", {"at": [1.571, 2.5]}),
            ("fill-range", {}),
            ("repeat-input", {}),
            ("other-input", {}),
            ("in-use", {}),
        )
    ),
    # plausibility
    Finding("map-turns-without-data", "wiener", {"model": "wiener", "block": 2, "at": 1.571}),
    Finding("map-leaves-range", "wiener", {"model": "wiener", **LEAVES}),
    Finding("faster-than-sampling", data={"model": "output-error", "pole": 0.1, "samples": 0.434}),
    Finding("diverges-beyond-range", "polynomial-narx", {"model": "polynomial-narx", "factor": 1.2}),
    Finding("diverges-on-steps", "feedback", {"model": "feedback"}),
    Finding("delay-longer-than-rise", data={"model": "arx", **TOO_LATE}),
    Finding("zero-cancels-pole", data={"model": "arx", "pole": [0.9, 0.0]}),
    # the quality of data
    Finding("channel-constant", "u", {"level": 2.0, "unit": "V"}),
    Finding("channel-out-of-scale", "u", {"largest": 4.97e300}),
    Finding(
        "output-constant",
        "y",
        {"level": 0.0, "unit": "rad/s", "input": "u", "low": -1.5, "high": 2.0, "input_unit": "V"},
    ),
    Finding("record-too-short", "log.csv", {"samples": 14, "needed": 50}),
    *(
        Finding(code, "u", {"order": order, "linear": 4, "friction": 8, "at_least": True})
        for code, order in (("excitation-too-low", 1), ("excitation-linear-only", 6), ("excitation-sufficient", 50))
    ),
    Finding("few-input-levels", "u", {"levels": 2}),
    Finding("input-may-be-continuous", "u"),
    Finding("output-without-sign", "y", {"input": "u", "confidence": 0.5}),
    Finding("no-response", "y", {"input": "u"}),
    *(
        Finding(code, "y", {"input": "u", "delay": delay, "time": 0.01 * delay, "confidence": 0.95})
        for code, delay in (
            ("response-delay", 0),
            ("response-delay", 1),
            ("response-delay", 230),
            ("response-negative", 2),
        )
    ),
    Finding(
        "files-of-another-system",
        "old.dat",
        {"files": ["old.dat"], "others": ["a.dat", "b.dat"], "words": ["Prescaler"], "ratio": 8.2},
    ),
    Finding("records-of-opposite-sign", "b.csv", {"records": ["b.csv", "c.csv"], "of": 5}),
    Finding("feedback-likely", "u", {"output": "y", "correlation": 0.4, "confidence": 0.9}),
    *(Finding(code, "y", {"share": 0.4, "reversals": 3}) for code in ("all-standstill", "much-standstill")),
    *(Finding("motion", "y", {"share": 0.04, "reversals": count}) for count in (0, 1, 38)),
    *(
        Finding(code, "u", {"dead_zone": 0.8, "amplitude": high, "inside": 0.3, "unit": "V", "confidence": 0.7})
        for code, high in (("dead-zone-likely", 6.0), ("amplitude-near-dead-zone", 1.1))
    ),
    Finding("coarse-values", "y", {"step": 4.06, "unit": "rad/s", "levels": 7.7}),
    Finding("values-cut-off", "y", {"side": "upper", "limit": 10.0, "unit": "rad/s", "share": 0.08}),
    Finding("command-limited", "u", {"side": "lower", "limit": -255.0, "unit": "", "share": 0.18}),
    *(Finding("outliers", "y", {"count": n, "sample": 123, "size": 80.0, "confidence": 0.8}) for n in (1, 4)),
    Finding("clock-jitters", "log.csv", {"jitter": 0.03, "deviation": 3e-4}),
    Finding("samples-repeated", "y", {"factor": 5, "dt": 0.001, "better": 0.005}),
    Finding("aliasing-possible", "y", {"share": 0.15, "frequency": 175.0, "confidence": 0.5}),
    Finding("output-integrates", "y", {"input": "u"}),
    Finding("sampling-too-slow", "y", {"time_constant": 0.1, "samples": 1.0, "dt": 0.1, "confidence": 0.9}),
    Finding(
        "sampling-too-fast",
        "y",
        {"time_constant": 0.4, "samples": 400.0, "dt": 0.001, "factor": 8, "confidence": 0.9},
    ),
    Finding("output-drifts", "y", {"change": 2.5, "unit": "rad/s", "confidence": 0.8}),
    *(
        Finding(
            "distortion-levels",
            "y",
            {"periods": 5, "period": 1.0, "lines": 20, "noise": 0.01, "even": 0.002, "odd": odd},
        )
        for odd in (0.12, 0.003)
    ),
    *(
        Finding(
            code, "y", {"share": share, "of_residual": part, "coherence": 0.9, "fit_percent": 82.0, "confidence": 0.9}
        )
        for code, share, part in (("nonlinear-likely", 0.03, 0.8), ("nearly-linear", 1e-4, 0.01))
    ),
    Finding("unexplained-output", "y", {"fit_percent": -12.0, "input": "u", "confidence": 0.9}),
    # files
    Finding("role-uncertain", "c2", {"role": "input", "confidence": 0.5}),
    Finding("no-role-found", "log.csv", {"roles": ["input", "output"]}),
    Finding("not-readable", "log.csv", {"reason": "the mask leaves nothing", "arguments": ["mask"]}),
    Finding("several-experiments", "log.csv", {"chosen": ["u1", "z1"], "pairs": [["u2", "z2"], ["u3", "z3"]]}),
    Finding("sample-time-unknown", "log.csv", {"assumed": 1.0}),
    *(
        Finding("time-unit-assumed", subject, {"unit": "ms", "dt": 0.01, "confidence": 0.7, "source": source})
        for subject, source in (("t", "column"), ("log.csv", "preamble"), ("log_dt10.csv", "file name"))
    ),
    *(
        Finding("sample-time-from-text", "log.csv", {"dt": 0.01, "source": source})
        for source in ("preamble", "file name")
    ),
    *(
        Finding("clock-irregular", "t", {"gaps": gaps, "longest": 0.5, "duplicates": 2, "jitter": 0.1, "dt": 0.01})
        for gaps in (0, 1)
    ),
    Finding(
        "isolated-values",
        "PWM",
        {
            "low": -255.0,
            "high": 255.0,
            "codes": [
                {"value": 999.0, "count": 50, "share": 0.01, "response": ""},
                {"value": 1000.0, "count": 290, "share": 0.073, "response": "falls"},
            ],
        },
    ),
    Finding("values-missing", "y", {"count": 99, "rows": 2000}),
    Finding("value-stuck", "y", {"row": 400, "length": 120, "value": 3.5}),
    Finding("position-differentiated", "qm", {"input": ""}),
    Finding("position-differentiated", "y", {"input": "u"}),
    Finding("rows-of-messages", "can.csv", {"rows": 6030, "columns": ["voltage", "speed"]}),
    Finding("position-wraps", "enc", {"period": 65536.0}),
    Finding("direction-column", "pwm", {"column": "dir", "output": "rpm"}),
    Finding("reference-column", "r", {"input": "u", "follows": "y"}),
    Finding("difference-of-position", "mVel", {"position": "mStep"}),
    Finding("sample-time-contradicted", "log.dat", {"dt": 0.01, "said": 0.002, "source": "preamble"}),
    Finding("sample-time-implausible", "log.csv", {"dt": 10.048}),
    Finding("sample-time-implausible", "log.csv", {"dt": 1e-8}),
    *(
        Finding("rows-skipped", "log.csv", {"count": count, "rows": 9000, "line": 8253, "text": text, "messages": 1})
        for count, text in ((1, "[RxCallback]Communication Status #: 6"), (3, ""))
    ),
    *(
        Finding("data-filtered", "log.csv", {"cutoff": cutoff, "factor": factor})
        for cutoff, factor in ((20.0, 1), (None, 4), (20.0, 4))
    ),
    *(Finding("clock-reset", "log.csv", {"count": count, "column": "t", "line": 32}) for count in (1, 2)),
    # the study
    Finding("study-load-friction", data=LOAD_FRICTION | {"unfair_from": None, "visible_from": 0.062}),
    Finding("study-load-friction", data=LOAD_FRICTION | {"unfair_from": 0.05, "visible_from": None}),
    Finding("study-paper-ratios", "paper-narx", {"study": "simulation", "rows": PAPER_RATIOS}),
    Finding("study-survey-recorded"),
    Finding("study-many-inputs", "paper-narx", {"rows": MANY_INPUTS}),
    Finding("study-what-decides", "paper-narx", WHAT_DECIDES),
    Finding("study-what-decides", "paper-narx", WHAT_DECIDES | {"odd": None}),
    Finding("study-largest-ratio", "paper-narx", LARGEST | {"reached": ["nearly one sine"]}),
    Finding("study-largest-ratio", "paper-narx", LARGEST | {"reached": []}),
    Finding("study-two-masses", "motor", {"rows": TWO_MASSES, "fixed": ["resistance", "rotor_viscous"]}),
    Finding("study-excitation", "experiment", EXCITATION | {"richer": RICHER}),
    Finding("study-excitation", "experiment", EXCITATION | {"order": 16, "richer": None}),
    Finding("study-even-terms", "paper-narx", {"study": "experiment", "better": 0.9, "paper": 4.0}),
    Finding("study-own-simulator", "motor", {"study": "simulation", "fixed": ["resistance", "rotor_viscous"]}),
    Finding("study-noise-free"),
    Finding("study-virtual-bench"),
    Finding("study-one-step", "arx", {"study": "experiment", "method": "ls", "ratio": 1234.0}),
    Finding("study-recursive-and-batch", "arx", {"study": "experiment", "difference": 0.001, "forgetting": 0.999}),
    Finding("study-recursive-and-batch", "arx", RECURSIVE | {"vanishes_at": 1e12}),
    Finding("study-recursive-and-batch", "arx", RECURSIVE | {"vanishes_at": None}),
    Finding("study-rank-deficient", "narx", {"study": "simulation", "method": "ls", "rank": 8, "parameters": 9}),
    Finding("study-model-failed", "blocks", {"study": "simulation", "problem": "the input is too short"}),
)


def golden() -> str:
    """Every example as Python and as the command line words it."""
    lines = []
    for finding in sorted(EXAMPLES, key=lambda each: each.code):
        lines.append(f"{finding.code} ({severity(finding).value})")
        python, command = sentence(finding), sentence(finding, option)
        lines.append(f"  {python}")
        if command != python:
            lines.append(f"  {command}")
    return "\n".join(lines) + "\n"


def test_every_sentence_is_the_one_in_the_file() -> None:
    assert golden().splitlines() == SENTENCES.read_text("utf-8").splitlines()


def test_every_code_has_an_example() -> None:
    assert {finding.code for finding in EXAMPLES} == set(CATALOGUE)


@pytest.mark.parametrize("finding", EXAMPLES, ids=lambda finding: finding.code)
def test_a_sentence_is_one_line_with_one_full_stop_at_its_end(finding: Finding) -> None:
    said = sentence(finding)
    assert said.endswith(".")
    assert not said.endswith("..")
    assert "\n" not in said
    assert "  " not in said
    assert "None" not in said
    assert "--" not in said
    assert json.loads(json.dumps(finding.to_data(), allow_nan=False)) == finding.to_data()


# Riddles and private vocabulary; the table of plain words is longer.
@pytest.mark.parametrize(
    "word",
    ["guess", "told", "tell apart", "held", "brought home", "throughout", "judge by what", "so many", "set aside"],
)
def test_sentences_are_in_plain_words(word: str) -> None:
    assert word not in golden().lower()


# --- the codes of the catalogue and those of the program -------------------------------------------------------------


def strings(path: Path) -> Iterator[str]:
    """Every text in a file of Python, but for docstrings."""
    documents = {
        id(node.body[0].value)
        for node in nodes_of(path)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
        and node.body
        and isinstance(node.body[0], ast.Expr)
    }
    for node in nodes_of(path):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in documents:
            yield node.value


def constructed(path: Path) -> Iterator[str]:
    """The codes that findings are made with, where they are written in the call."""
    for node in nodes_of(path):
        if isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] == "Finding":
            first: Any = node.args[0] if node.args else next((k.value for k in node.keywords if k.arg == "code"), None)
            for each in ast.walk(first) if first is not None else ():
                if isinstance(each, ast.Constant) and isinstance(each.value, str):
                    yield each.value


SOURCES = [path for path in HOME.rglob("*.py") if path.parent.name != "wording"]


def test_every_finding_in_the_program_has_words() -> None:
    assert {code for path in SOURCES for code in constructed(path)} <= set(CATALOGUE)


def test_every_code_with_words_is_used_in_the_program() -> None:
    used = {text for path in SOURCES for text in strings(path)}
    assert set(CATALOGUE) - used == set()


def test_every_code_is_triggered_by_a_test() -> None:
    not_here = (Path(__file__).name, "test_findings_absent.py")  # which name codes that they do not trigger
    tests = [path for path in TESTS.glob("test_*.py") if path.name not in not_here]
    named = {text for path in tests for text in strings(path)}
    assert set(CATALOGUE) - named == set()


# --- the catalogue itself --------------------------------------------------------------------------------------------


def test_a_code_is_in_small_letters_with_hyphens() -> None:
    with pytest.raises(ValueError, match="small letters"):
        Finding("Input_Constant")


def test_a_code_has_one_wording() -> None:
    from emsid.wording import words

    with pytest.raises(ValueError, match="two wordings for 'few-samples'"):
        words("few-samples", Severity.INFO)(lambda f, argument: "")


def test_the_model_stands_before_the_sentence_once() -> None:
    alone = Finding("few-samples", data={"samples": 4.0, "parameters": 2})
    assert sentence(alone.about("arx")) == f"arx: {sentence(alone)}"
    text = CATALOGUE["few-samples"].wording(alone, str)
    assert sentence(alone) == f"{text}."


if __name__ == "__main__":
    SENTENCES.write_text(golden(), "utf-8")
