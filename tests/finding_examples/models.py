"""Examples of what searches, cascades and plants say."""

from emsid.findings import Finding

SO_FAR = {"steps": 12, "offset": 3.4}
IDENTIFIABLE = {
    "model": "rigid-motor",
    "channels": ["voltage", "speed"],
    "parameters": ["resistance", "motor_constant"],
    "current_missing": True,
}
RISE = {"rise": 0.354, "half": 0.011, "seconds": 30.0, "heats": False, "final": None, "time_constant": None}
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
    Finding(
        "alternatives-fit-as-well",
        data={"instead": ["inductance", "sensor.lag"], "of": "drive.delay", "late": False},
    ),
    Finding("alternatives-fit-as-well", data={"instead": ["sensor.average"], "of": None, "late": False}),
    Finding("alternatives-fit-as-well", data={"instead": ["drive.delay"], "of": None, "late": True}),
    Finding(
        "effect-missing",
        "rigid-motor",
        {"effect": "stribeck", "or": [], "parameters": ["rotor_friction.stribeck"], "share": 0.85},
    ),
    Finding(
        "effect-missing",
        "rigid-motor",
        {"effect": "lag", "or": ["average", "delay"], "parameters": ["sensor.lag"], "share": 0.66},
    ),
    Finding(
        "value-contradicted",
        "voltage_dead_zone.half_width",
        {"value": 0.4, "better": 0.0, "unit": "V", "share": 0.93, "or": []},
    ),
    Finding(
        "value-contradicted",
        "motor_constant",
        {"value": 0.05, "better": 0.0594, "unit": "N*m/A", "share": 0.93, "or": ["viscous"]},
    ),
    Finding("parameter-changes", "resistance", {"halves": [1.02, 1.14], "unit": "ohm", "share": 0.55, "or": []}),
    Finding("residual-slow", "rigid-motor", {"values": 11.3, "samples": 1500}),
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
    Finding("kept-by-response", "motor", {"parameters": ["resistance"], "kept": [["resistance", 2.0, "ohm"]]}),
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
            "zone_unseen": True,
        },
    ),
    Finding("parameter-at-bound", "inductance", {"side": "lower", "bound": 4e-4, "because": "sample-time"}),
    Finding("parameters-undetermined", data={"without_effect": ["f.m_l"], "inseparable": [["R", "K"]]}),
    Finding("parameters-undetermined", data={"without_effect": [], "inseparable": [[f"s{k}" for k in range(1, 39)]]}),
    # cascades
    Finding("choices-cut-short", "wiener", {"cancelled": True}),
    Finding("other-number-of-maps", "feedback", {"maps": 1, "asked": 2}),
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
    *(
        Finding(
            "fitted-to-all-data",
            "log.csv",
            {"model": "feedback", "samples": 1024, "of": 717, "searched": searched, "larger": larger},
        )
        for searched, larger in ((False, False), (True, True), (True, False))
    ),
    Finding("fitted-to-excerpt", "log.csv", {"samples": 20_000, "of": 350_000, "finished": "rigid-motor"}),
    Finding("fitted-to-excerpt", "log.csv", {"samples": 20_000, "of": 350_000, "finished": ""}),
    Finding("unstable-in-loop", "y", {"pole": 1.13, "time": 0.0266, "horizon": 9}),
    *(
        Finding("end-shows-little", "log.csv", {"share": 0.12, "first": 850, "last": 1149, "moved": moved})
        for moved in (True, False)
    ),
    Finding("input-taken-as-constant", "force", {"between": "band-limited", "ratio": 41.5}),
    Finding("input-taken-as-linear", "force", {"between": "band-limited", "ratio": 2.72}),
    Finding(
        "input-between-rows-unknown",
        "brushless",
        {"parameters": ["resistance", "inductance_d"], "inputs": ["v_d", "v_q"], "rows": 9, "ratio": 1.26},
    ),
    Finding("input-between-samples", "voltage", {"straight": 1, "held": 0}),
    Finding("input-between-samples", "voltage", {"straight": 2, "held": 1}),
    Finding("speed-is-a-mean", "speed"),
    Finding("cogging-over-angle", "brushless", {"size": 0.0413, "unit": "N*m", "share": 0.066, "number": 42}),
    Finding("torque-ripple-over-angle", "brushless", {"size": 0.1, "number": 42}),
    Finding("friction-fades-as-gaussian", "rigid-motor"),
    Finding("unit-assumed", "rigid-motor", {"channel": "y", "signal": "speed", "unit": "rad/s"}),
    Finding("unit-assumed", "rigid-motor", {"channel": "Motor_Speed(RPM)", "signal": "speed", "unit": "rad/s"}),
    Finding("command-unit-assumed", "rigid-motor", {"channel": "u", "unit": "volts"}),
    Finding("command-unit-assumed", "rigid-motor", {"channel": "u [mV]", "unit": "volts"}),
    Finding("command-may-be-duty", "rigid-motor", {"channel": "PWM", "full": 255.0}),
    Finding("command-may-be-duty", "rigid-motor", {"channel": "PWM", "full": 1023.0}),
    Finding("codes-without-bridge", "rigid-motor", {"codes": [999.0], "nothing": "torque"}),
    Finding("no-shaft-seen", "motor", {"model": "motor", "simpler": "rigid-motor"}),
    Finding(
        "effects-alike",
        "rotor_friction.coulomb",
        {"effects": ["dead-zone", "load"], "combinations": [["b + R·(T_c + T_d)/K", 0.3098, 0.0016, "V"]]},
    ),
    Finding("effects-alike", "friction.coulomb", {"effects": ["load"], "combinations": []}),
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
    Finding(
        "not-identifiable",
        "rigid-motor",
        {
            "channels": ["voltage", "speed"],
            "parameters": ["rotor_friction.coulomb", "voltage_dead_zone.half_width"],
            "combinations": ["b + R·(T_c + T_s)/K"],
            "kept": [["resistance", 2.0, "ohm"], ["rotor_friction.coulomb", 0.001, "N*m"]],
            "current_missing": False,
            "one_way": True,
            "zone_unseen": True,
        },
    ),
    Finding(
        "not-identifiable",
        "joint",
        IDENTIFIABLE | {"combinations": ["K/R"], "kept": [["resistance", 2.0, "ohm"]], "one_load": True},
    ),
    Finding(
        "not-identifiable",
        "brushless",
        IDENTIFIABLE
        | {"model": "brushless", "parameters": ["flux", "inertia"], "combinations": [], "current_missing": False}
        | {"kept": [["flux", 0.005, "Wb"]], "tests": {"q-axis": ["flux", "inertia"]}},
    ),
    Finding(
        "intervals-include-zero",
        "brushless",
        {"parameters": ["flux", "inertia"], "without": [], "tests": {"d-axis": ["flux"], "q-axis": ["inertia"]}},
    ),
    Finding("error-above-rounding", "joint", {"ratio": 2.1, "step": 0.001534, "unit": "rad"}),
    Finding("within-rounding", "joint", {"step": 0.001534, "unit": "rad", "narrower": 5.2}),
    Finding("outside-rounding", "joint", {"step": 0.001534, "unit": "rad", "least": 0.61}),
    Finding("weakly-identified", "rigid-motor", IDENTIFIABLE | {"combinations": ["K/R"]}),
    Finding("weakly-identified", "rigid-motor", IDENTIFIABLE | {"parameters": ["drive.delay"], "combinations": []}),
    Finding("damping-open", "rotor_viscous", {"parameters": ["motor_constant"], "most": 1.2e-4, "unit": "N*m*s/rad"}),
    Finding("intervals-include-zero", "rigid-motor", {"parameters": ["sensor.lag"], "without": ["sensor.lag"]}),
    Finding("intervals-include-zero", "rigid-motor", {"parameters": ["a", "b"], "without": []}),
    *(
        Finding("gravity-not-seen", "gravity.torque", {"moved": moved, "most": most, "unit": "N*m"})
        for moved, most in ((0.9, 32.0), (0.9, None), (556.0, 9.4e-6))
    ),
    Finding("choice-interrupted", "rigid-motor", {"model": "rigid-motor"}),
    Finding("resistance-changes", "rigid-motor", RISE),
    Finding("resistance-changes", "rigid-motor", RISE | {"heats": True, "rise": -0.031, "half": None}),
    Finding("resistance-changes", "rigid-motor", RISE | {"heats": True, "final": 0.52, "time_constant": 213.0}),
    Finding("load-drifts", "linear-axis", LOAD | {"parameters": []}),
    Finding("load-drifts", "linear-axis", LOAD),
    Finding("load-drifts", "linear-axis", LOAD | {"walks": False}),
    Finding("load-drifts", "linear-axis", LOAD | {"mean": 0.12}),
    Finding(
        "load-drifts", "linear-axis", LOAD | {"parameters": ["friction.coulomb.forward", "friction.coulomb.backward"]}
    ),
    Finding(
        "free-run-drifts", "linear-axis", {"seconds": 5.312, "error": 0.00108795, "whole": 0.00203921, "unit": "m"}
    ),
    Finding("probably-another-system", "rigid-motor", {"left": 0.76, "linear": 0.098, "regression": None}),
    Finding("probably-another-system", "rigid-motor", {"left": 0.76, "linear": 0.4, "regression": 0.02}),
)
