"""Examples of what the study says."""

from emsid.findings import Finding

LOAD_FRICTION = {"mse": 0.012, "share": 0.001, "paper": 0.01, "at_most": 0.1, "errors": [0.106, 0.107], "difference": 1}
PAPER_RATIOS = [
    {"study": "simulation", "data": "identification", "paper": 22.02, "free_run": 0.985, "one_step": 0.999},
    {"study": "simulation", "data": "unseen", "paper": 557.2, "free_run": 0.982, "one_step": 0.998},
]
BOTH_RATIOS = [
    {"study": "experiment", "data": "unseen", "paper": 2.83, "free_run": 0.991, "one_step": 1.002},
    *PAPER_RATIOS,
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
    "readings": 11,
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
RICHER = {"order": 16, "condition": 370.0, "crest_factor": 1.44, "errors": {"arx": [39.3, 53.4], "narx": [21.2, None]}}
RECURSIVE = {
    "study": "simulation",
    "difference": 0.28,
    "forgetting": 1.0,
    "condition": 3.7e9,
    "covariance": 1e8,
    "ridge": -0.28,
}

EXAMPLES: tuple[Finding, ...] = (
    Finding("study-load-friction", data=LOAD_FRICTION | {"unfair_from": None, "visible_from": 0.062}),
    Finding("study-load-friction", data=LOAD_FRICTION | {"unfair_from": 0.05, "visible_from": None}),
    Finding("study-paper-ratios", "paper-narx", {"rows": PAPER_RATIOS}),
    Finding("study-paper-ratios", "paper-narx", {"rows": BOTH_RATIOS}),
    Finding(
        "study-best-model",
        "rigid-motor",
        {"study": "experiment", "parameters": 7, "fit_percent": 99.56, "ratio": 2034.5},
    ),
    Finding("study-best-model", "arx", {"study": "experiment", "parameters": 8, "fit_percent": 99.9, "ratio": 1.0}),
    Finding("study-survey-recorded"),
    Finding("study-many-inputs", "paper-narx", {"rows": MANY_INPUTS}),
    Finding("study-what-decides", "paper-narx", WHAT_DECIDES),
    Finding("study-what-decides", "paper-narx", WHAT_DECIDES | {"odd": None}),
    Finding("study-what-decides", "paper-narx", WHAT_DECIDES | {"even": None}),
    Finding("study-largest-ratio", "paper-narx", LARGEST | {"reached": ["nearly one sine"]}),
    Finding("study-largest-ratio", "paper-narx", LARGEST | {"reached": []}),
    Finding("study-two-masses", "motor", {"rows": TWO_MASSES, "fixed": ["resistance", "rotor_viscous"]}),
    Finding("study-excitation", "experiment", EXCITATION | {"richer": RICHER}),
    Finding("study-excitation", "experiment", EXCITATION | {"order": 16, "richer": None}),
    Finding(
        "study-even-terms",
        "paper-narx",
        {
            "studies": [
                {"study": "experiment", "better": 0.9, "paper": 4.0},
                {"study": "simulation", "better": 0.98, "paper": 557.2},
            ]
        },
    ),
    Finding("study-own-simulator", "motor", {"study": "simulation", "fixed": ["resistance", "rotor_viscous"]}),
    Finding("study-noise-free"),
    Finding("study-virtual-bench"),
    Finding("study-one-step", "arx", {"study": "experiment", "method": "ls", "ratio": 1234.0}),
    Finding("study-recursive-and-batch", "arx", {"study": "experiment", "difference": 0.001, "forgetting": 0.999}),
    Finding("study-recursive-and-batch", "arx", RECURSIVE | {"vanishes_at": 1e12}),
    Finding("study-recursive-and-batch", "arx", RECURSIVE | {"vanishes_at": None}),
    Finding("study-rank-deficient", "narx", {"study": "simulation", "method": "ls", "rank": 8, "parameters": 9}),
    Finding(
        "study-model-failed", "blocks", {"study": "simulation", "problem": "the input is too short", "internal": False}
    ),
)
