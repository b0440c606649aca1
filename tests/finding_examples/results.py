"""Examples of what is said of a result: what was asked for, how good it is, and how plausible."""

from emsid.findings import Finding

RESIDUAL = {"model": "arx", "lags": 25}
ONE_OUTPUT = [{"name": "speed", "unit": "rad/s", "rmse": 1.25, "fit_percent": 92.3}]
LEAVES = {"block": 2, "at": 1.571, "value": -90.0, "low": -1.2, "high": 1.1}
TOO_LATE = {"delay": 3.6, "rise": 0.4, "samples": 360}

EXAMPLES: tuple[Finding, ...] = (
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
    Finding(
        "model-failed",
        "feedback",
        {
            "model": "feedback",
            "reason": "an error inside the program (IndexError: index 3 is out of bounds)",
            "arguments": ["debug"],
        },
    ),
    Finding("part-failed", "check of arx", {"model": "arx", "reason": "too few samples", "internal": False}),
    Finding(
        "part-failed",
        "section of the page: arx",
        {"model": "arx", "reason": "an error inside the program (KeyError: 'gain')", "internal": True},
    ),
    *(Finding("models-out-of-time", data={"models": models}) for models in (["wiener"], ["wiener", "feedback"])),
    Finding("models-of-one-output", "log.csv", {"outputs": 2, "models": ["arx", "feedback"], "output": "speed"}),
    Finding("quick-look", "log.csv", {"without": ["wiener-hammerstein", "rigid-motor"]}),
    *(
        Finding("models-not-needed", "rigid-motor", {"model": "rigid-motor", "models": models})
        for models in (["wiener-hammerstein", "feedback"], ["wiener-hammerstein"])
    ),
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
    Finding("source-disconnected", "serial:///dev/ttyACM0", {"wait": 30.0}),
    Finding("nothing-excites", "log.csv", {"inputs": [{"name": "u", "level": 0.0, "unit": "V"}], "samples": 200}),
    Finding("source-awaited", "serial:///dev/ttyACM0", {"lines": 0, "example": ""}),
    Finding("source-awaited", "serial:///dev/ttyACM0", {"lines": 12, "example": "ready"}),
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
    Finding("input-explains-nothing", "speed", {"shuffled": 1.0, "held": 0.99, "by": "feedback"}),
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
            "map-beyond-range",
            "feedback",
            {
                "map": map_,
                "low": -2.0,
                "high": 3.5,
                "fitted_low": -1.25,
                "fitted_high": 1.5,
                "share": 0.125,
                "seen": False,
            },
        )
        for map_ in (None, 2)
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
    Finding("residual-not-tested", "arx", {"model": "arx", "output": "speed", "independent": 12.7}),
    Finding(
        "record-shifted",
        "late.csv",
        {"output": "speed", "delay": 0.0094, "samples": 0.47, "rmse": 11.7, "shifted": 4.33, "unit": "deg/s"},
    ),
    Finding("next-measure", "rigid-motor", {"parameters": ["resistance"], "current": True}),
    Finding("next-measure", "joint", {"parameters": ["motor_constant", "gravity.mass"], "current": False}),
    Finding("next-check-data", "log.csv", {"fit_percent": 12.0}),
    Finding("next-reduce-noise", "log.csv", {"fit_percent": 28.3}),
    Finding("next-physical-model", "arx"),
    Finding("dictionary-rank-deficient", data={"rank": 25, "terms": 35}),
    Finding("intervals-by-bootstrap", "armax", {"model": "armax", "count": 199, "pieces": 30, "samples": 1200}),
    Finding(
        "no-bootstrap",
        "armax",
        {"model": "armax", "reason": "the records make 3 pieces, but a bootstrap needs 6", "arguments": []},
    ),
    Finding("few-unseen-samples", "log.csv, unseen part", {"samples": 6, "needed": 50}),
    Finding("few-unseen-samples", "log.csv, unseen part", {"samples": 1, "needed": 50}),
    Finding("delay-from-data", "speed", {"input": "u", "delay": 36, "time": 0.036}),
    # plausibility
    Finding("map-turns-without-data", "wiener", {"model": "wiener", "block": 2, "at": 1.571}),
    Finding("map-leaves-range", "wiener", {"model": "wiener", **LEAVES}),
    Finding("gain-of-other-sign", data={"model": "arx", "input": "voltage", "output": "speed", "sign": -1}),
    Finding("faster-than-sampling", data={"model": "output-error", "pole": 0.1, "samples": 0.434}),
    Finding("diverges-beyond-range", "polynomial-narx", {"model": "polynomial-narx", "factor": 1.2}),
    Finding("diverges-on-constant-input", "feedback", {"model": "feedback"}),
    Finding("diverges-on-steps", "feedback", {"model": "feedback"}),
    Finding("delay-longer-than-rise", data={"model": "arx", **TOO_LATE}),
    Finding("zero-cancels-pole", data={"model": "arx", "pole": [0.9, 0.0]}),
)
