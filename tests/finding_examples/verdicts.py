"""Examples of the verdict on a model, and of its recommendation."""

from emsid.findings import Finding
from finding_examples.results import LEAVES, TOO_LATE

PAST = {"output": "speed", "input": "u", "lags": 51, "at_lag": 4, "limit": 3.9, "p_value": 0.0, "passed": False}
LIMITS = [
    {"code": "explains-little", "fit_percent": 42.0},
    {"code": "output-at-rest"},
    {"code": "output-moves-little", "share": 0.047},
    {"code": "depends-on-past-inputs", "share": 0.12, **PAST, "largest": 12.3},
    {"code": "depends-on-nonlinear-term", "share": 0.12, **PAST, "largest": -8.0, "term": "u³", "kind": "odd"},
    {"code": "one-step-errors-coloured", "output": "speed", "largest": 0.6, "at_lag": 1},
    {"code": "another-is-better", "other": "motor", "left": 0.037},
    {"code": "pieces-differ", "kind": "gain", "output": "speed", "unit": "rad/s", "spread": 0.08, "share": 0.4},
    {"code": "pieces-differ", "kind": "delay", "output": "speed", "unit": "rad/s", "spread": 0.02, "share": 0.4},
    {"code": "pieces-differ", "kind": "level", "output": "speed", "unit": "rad/s", "spread": 2.0, "share": 0.4},
    {"code": "larger-on-unseen", "ratio": 2.8},
    {"code": "another-differs", "other": "output-error", "times": 4.2},
    {"code": "parts-differ", "times": 1.24},
    {"code": "parts-differ", "times": None},
    {"code": "response-uncertain"},
    {"code": "few-levels", "levels": 2},
    {"code": "no-gain-over-trend", "share": 0.97},
    {"code": "stable-model-of-unstable", "pole": 1.13, "horizon": 9},
    {"code": "only-in-loop", "pole": 1.13, "horizon": 9},
    {"code": "error-in-one-stretch", "share": 0.7, "first": 3000, "last": 3200, "from": 30.0, "to": 32.0},
    {"code": "search-not-finished", "ending": "stalled"},
]
RECOMMENDED = {
    "fit_percent": 97.3,
    "models": 9,
    "others": 0,
    "folds": 1,
    "seen": False,
    "verdict": "model-supported",
    "reasons": [],
    "ahead": None,
    "tests_failed": 0,
}

EXAMPLES: tuple[Finding, ...] = (
    Finding("model-supported", "arx", {"model": "arx", "reasons": [], "tests": []}),
    Finding("model-supported", "arx", {"model": "arx", "reasons": [], "tests": [{"passed": False}]}),
    *(
        Finding("model-unusable", "arx", {"model": "arx", "reasons": [reason], "tests": []})
        for reason in (
            {"code": "diverges", "sample": 54},
            {"code": "no-better-than-mean", "fit_percent": -37.2},
            {"code": "input-explains-nothing", "shuffled": 1.0, "held": 0.99},
        )
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
            {"tests_failed": 1, "others": 1},
            {"models": 7, "others": 4},
            {"models": 3, "ahead": 9, "fit_percent": None},
            {"verdict": "model-limited", "reasons": LIMITS[:2]},
            {"verdict": "model-limited", "reasons": LIMITS},
            {
                "instead_of": "hammerstein",
                "because": {"code": "map-leaves-range", **LEAVES},
                "unfinished": False,
                "ratio": 1.013,
                "parameters": [6, 6],
                "same_in": "noise",
            },
            *(
                {
                    "instead_of": "hammerstein",
                    "because": None,
                    "unfinished": same_in == "practice",
                    "ratio": 1.013,
                    "parameters": [10, 57],
                    "folds": 4,
                    "same_in": same_in,
                }
                for same_in in ("noise", "practice")
            ),
        )
    ),
    *(
        Finding("best-not-recommended", "arx", RECOMMENDED | {"verdict": verdict, "reasons": [reason]})
        for verdict, reason in (
            ("model-limited", {"code": "few-levels", "levels": 2}),
            ("model-implausible", {"code": "map-turns-without-data", "block": 2, "at": 1.571}),
        )
    ),
    Finding(
        "no-model-recommended",
        "arx",
        RECOMMENDED | {"verdict": "model-unusable", "reasons": [{"code": "diverges", "sample": 54}]},
    ),
    Finding("next-test", "brushless", {"tests": {"q-axis": ["flux", "inertia"]}}),
    *(
        Finding("next-experiment", "log.csv", {"kind": kind, **more})
        for kind, more in (
            ("longer", {"samples": 30, "needed": 50}),
            ("without-feedback", {}),
            ("test-signal", {}),
            ("more-levels", {"levels": 2}),
            ("larger-input", {}),
            ("faster-sampling", {"dt": 0.01}),
            ("finer-sensor", {}),
            ("both-directions", {"input": "u"}),
            ("fill-range", {"at": [1.571, 2.5]}),
            ("fill-range", {}),
            ("repeat-input", {}),
            ("second-load", {}),
            ("other-input", {}),
            ("in-use", {}),
        )
    ),
)
