"""Examples of what is said of data and files."""

from emsid.findings import Finding

EXAMPLES: tuple[Finding, ...] = (
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
        Finding(code, "y", {"input": "u", "delay": delay, "time": 0.01 * delay, "sign": sign, "confidence": 0.95})
        for code, delay, sign in (
            ("response-delay", 0, 1),
            ("response-delay", 1, 1),
            ("response-delay", 230, 0),
            ("response-negative", 2, -1),
        )
    ),
    Finding(
        "files-of-another-system",
        "old.dat",
        {"files": ["old.dat"], "others": ["a.dat", "b.dat"], "words": ["Prescaler"], "ratio": 8.2},
    ),
    Finding("files-equal", "a.csv", {"copies": ["b.csv", "c.csv"]}),
    Finding("records-of-opposite-sign", "b.csv", {"records": ["b.csv", "c.csv"], "of": 5}),
    *(Finding("angle-hangs", "angle", {"angle": at, "unit": "rad", "period": 0.81}) for at in (0.3, None)),
    *(
        Finding("angle-without-unit", "angle", {"turn": turn, "seems": seems})
        for turn, seems in ((4024.0, ""), (354.0, "deg"))
    ),
    Finding("one-load", "voltage", {"output": "angle"}),
    Finding("output-noise-only", "y", {"input": "u"}),
    Finding("feedback-likely", "u", {"output": "y", "correlation": 0.4, "confidence": 0.9}),
    *(Finding(code, "y", {"share": 0.4, "reversals": 3}) for code in ("all-standstill", "much-standstill")),
    *(Finding("motion", "y", {"share": 0.04, "reversals": count}) for count in (0, 1, 38)),
    *(
        Finding(code, "u", {"dead_zone": 0.8, "amplitude": high, "inside": 0.3, "unit": "V", "confidence": 0.7})
        for code, high in (("dead-zone-likely", 6.0), ("amplitude-near-dead-zone", 1.1))
    ),
    Finding("coarse-values", "y", {"step": 4.06, "unit": "rad/s", "levels": 7.7}),
    *(
        Finding("joint-at-stop", "angle", {"side": "upper", "limit": 1.2, "unit": "rad", "share": 0.08} | more)
        for more in ({}, {"mask": "angle >= 1.2"}, {"masked": True})
    ),
    *(
        Finding("values-cut-off", "y", {"side": "upper", "limit": 10.0, "unit": "rad/s", "share": 0.08} | more)
        for more in ({}, {"mask": "y >= 10"})
    ),
    Finding("command-limited", "u", {"side": "lower", "limit": -255.0, "unit": "", "share": 0.18}),
    *(
        Finding("outliers", "y", {"count": n, "sample": 123, "size": 80.0, "confidence": 0.8, "mask": mask})
        for n, mask in ((1, ""), (4, "abs(y) > 50"))
    ),
    Finding("clock-jitters", "log.csv", {"jitter": 0.03, "deviation": 3e-4, "dt": 0.01}),
    Finding("sample-time-of-file", "other.csv", {"column": "t", "dt": 0.02, "before": 0.01}),
    Finding("data-resampled", "log.csv", {"dt": 0.01}),
    Finding("read-in-part", "log.csv", {"rows": 1_048_576, "of": 48_000_000, "whole": []}),
    Finding("read-in-part", "log.csv", {"rows": 1_048_576, "of": 48_000_000, "whole": ["resample", "filter"]}),
    Finding("outliers", "y", {"count": 2, "sample": 9, "size": 80.0, "confidence": 0.8, "mask": "", "masked": True}),
    Finding("output-clipped", "y", {"lower": -5.0, "upper": 5.0, "unit": "rad/s", "share": 0.4}),
    Finding(
        "output-clipped", "y", {"lower": -5.0, "upper": 5.0, "unit": "", "share": 0.4, "mask": "y <= -5 OR y >= 5"}
    ),
    Finding("few-output-levels", "y", {"levels": 3}),
    Finding("output-is-input", "y", {"input": "u", "factor": 2.0}),
    Finding("input-logged-slower", "u", {"output": "y", "factor": 2, "dt": 0.001}),
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
            {"periods": 5, "period": 1.0, "lines": 20, "noise": noise, "even": 0.002, "odd": odd, "least": noise / 4},
        )
        for noise, odd in ((0.01, 0.12), (0.01, 0.003), (0.8, 0.12))
    ),
    *(
        Finding(code, "y", {"share": share, "of_residual": part, "coherence": 0.9, "fit_percent": 82.0} | more)
        for code, share, part, more in (
            ("nonlinear-likely", 0.03, 0.8, {"confidence": 0.9}),
            ("nearly-linear", 1e-4, 0.01, {"confidence": 0.9, "because": "little"}),
            ("nearly-linear", 9e-5, 0.6, {"confidence": 0.4, "because": "small-error"}),
            ("nearly-linear", 1e-3, 0.1, {"confidence": 0.7, "because": "noise"}),
        )
    ),
    Finding("unexplained-output", "y", {"fit_percent": -12.0, "input": "u", "confidence": 0.9}),
    # files
    Finding("role-uncertain", "c2", {"role": "input", "confidence": 0.5}),
    Finding("no-role-found", "log.csv", {"roles": ["input", "output"]}),
    Finding("not-readable", "log.csv", {"reason": "the mask leaves nothing", "arguments": ["mask"]}),
    Finding("several-experiments", "log.csv", {"chosen": ["u1", "z1"], "pairs": [["u2", "z2"], ["u3", "z3"]]}),
    Finding("sample-time-unknown", "log.csv", {"assumed": 1.0}),
    *(
        Finding(
            "steady-states", "static.csv", {"input": "u", "output": "y", "rows": 40, "slope": 730.2, "at": 0.6} | more
        )
        for more in (
            {"dead": [-0.31, 0.31], "low": [-760.1, -1.3], "high": [759.8, 1.2]},
            {"dead": None, "low": None, "high": [759.8, 1.2]},
            {"dead": None, "low": None, "high": None},
        )
    ),
    Finding(
        "encoder-pulses",
        "encoder",
        {"low": 2.0, "high": 3.4, "edges": 46, "rate": 1045.4, "counts": "edges(encoder)"},
    ),
    Finding("edges-missed", "edges(A, B)", {"missed": 3, "edges": 4600}),
    *(
        Finding("time-unit-assumed", subject, {"unit": "ms", "dt": 0.01, "confidence": 0.7, "source": source})
        for subject, source in (("t", "column"), ("log.csv", "preamble"), ("log_dt10.csv", "file name"))
    ),
    *(
        Finding("sample-time-from-text", "log.csv", {"dt": 0.01, "source": source})
        for source in ("preamble", "file name", "fs")
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
    Finding("value-stuck", "y", {"row": 400, "length": 120, "value": 3.5, "masked": True}),
    *(Finding("value-stuck", "y", {"row": 400, "length": 120, "value": 3.5, "mask": mask}) for mask in ("", "y = 3.5")),
    Finding("position-differentiated", "qm", {"input": ""}),
    Finding("position-differentiated", "y", {"input": "u"}),
    Finding("rows-of-messages", "can.csv", {"rows": 6030, "columns": ["voltage", "speed"]}),
    Finding("position-wraps", "enc", {"period": 65536.0}),
    Finding("command-before-its-row", "motor pwm", {"output": "encoder"}),
    Finding("direction-column", "pwm", {"column": "dir", "output": "rpm"}),
    Finding("reference-column", "r", {"input": "u", "follows": "y"}),
    Finding("difference-of-position", "mVel", {"position": "mStep"}),
    Finding("sign-lost", "pwm", {"output": "enc", "candidates": ["dir"]}),
    Finding("sign-lost", "pwm", {"output": "enc", "candidates": []}),
    Finding(
        "further-channels",
        "log.csv",
        {"inputs": ["load torque"], "outputs": ["current"], "positions": ["count"]},
    ),
    Finding(
        "brushless-columns",
        "log.csv",
        {"voltages": ["v_d", "v_q"], "currents": ["i_d", "i_q"], "speed": "speed", "rests": False},
    ),
    Finding(
        "brushless-columns",
        "log.csv",
        {"voltages": ["v_q"], "currents": ["i_q"], "speed": "speed", "rests": True},
    ),
    Finding(
        "phases-of-motor",
        "log.csv",
        {"phases": ["v=ua,ub,uc", "i=ia,ib,ic"], "angle": "theta_e", "electrical": True},
    ),
    Finding("pole-pairs-open", "log.csv", {"usual": 7.0}),
    Finding("speed-electrical", "erpm", {"pole_pairs": None}),
    Finding("speed-electrical", "erpm", {"pole_pairs": 7}),
    Finding(
        "record-determines",
        "log.csv",
        {"turns": False, "currents": ["d", "q"], "known": ["resistance"], "unknown": ["flux"], "ratios": []}
        | {"tests": {"q-axis": ["flux"]}},
    ),
    Finding(
        "record-determines",
        "log.csv",
        {"turns": True, "currents": [], "known": ["flux"], "unknown": ["resistance", "inertia"], "ratios": ["inertia"]}
        | {"tests": {"d-axis": ["resistance"], "q-axis": ["inertia"]}},
    ),
    Finding(
        "record-determines",
        "log.csv",
        {"turns": True, "currents": ["d"], "known": ["flux"], "unknown": [], "ratios": [], "tests": {}},
    ),
    Finding("delay-ambiguous", "y", {"input": "u", "period": 22, "time": 1.1}),
    Finding("unit-unknown", "velocity [furlong/s]", {"unit": "furlong/s"}),
    Finding("unit-not-used", "current", {"unit": "A", "channels": ["u", "y"]}),
    *(
        Finding(
            "step-from-first-sample",
            "rpm",
            {
                "input": "pwm",
                "gain": 2.75,
                "time_constant": 0.225,
                "begins": begins,
                "level": 255.0,
                "unit": "rpm",
                "input_unit": "",
            },
        )
        for begins in (None, 0.024)
    ),
    *(
        Finding("sample-time-contradicted", "log.dat", {"dt": 0.01, "said": 0.002, "source": source})
        for source in ("preamble", "fs")
    ),
    Finding("axes-unchecked", "log.csv", {"turns": 0.04, "given": 7}),
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
    Finding("file-cut-off", "log.tdms", {"columns": {"y": [17, 60]}}),
    *(Finding("data-detrended", "log.csv", {"order": order}) for order in (0, 1, 2)),
    *(Finding("clocks-of-files", "y.csv", {"columns": ["u", "y"], "share": share}) for share in (1.0, 0.972)),
    *(Finding("clock-reset", "log.csv", {"count": count, "column": "t", "line": 32}) for count in (1, 2)),
)
