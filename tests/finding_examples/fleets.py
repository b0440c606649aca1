"""Findings on fleets."""

from emsid.findings import Finding

_OF_FLEET = {"centre": 0.00806, "deviation": 0.00014, "score": 34.0}
EXAMPLES = (
    Finding(
        "differs-from-fleet",
        "M02",
        {"parameter": "rotor_friction.coulomb", "unit": "N*m", "value": 0.01282, "half_width": 0.00015, **_OF_FLEET},
    ),
    Finding(
        "differs-from-fleet",
        "M02",
        {"parameter": "a1", "unit": "", "value": -0.7, "half_width": 0.0, **_OF_FLEET},
    ),
    Finding(
        "changed-over-periods",
        "M07",
        {
            "parameter": "rotor_inertia",
            "unit": "kg*m^2",
            "since": "2026-03-02",
            "before": 5e-5,
            "after": 7.5e-5,
            "half_width": 1e-6,
            "score": 25.0,
        },
    ),
    Finding(
        "differs-by-one-cause",
        "M04",
        {
            "causes": ["torque"],
            "factor": 1.37,
            "parameters": ["rotor_inertia"],
            "ratios": {"rotor_inertia": 1.38, "rotor_friction.coulomb": 1.36},
        },
    ),
    Finding(
        "differs-by-one-cause",
        "M05",
        {
            "causes": ["angle", "voltage"],
            "factor": 0.7,
            "parameters": ["rotor_inertia"],
            "ratios": {"motor_constant": 0.7, "rotor_inertia": 0.49},
        },
    ),
    Finding(
        "noisier-than-fleet",
        "M06",
        {
            "parameter": "noise of the output",
            "unit": "rad/s",
            "value": 1.46,
            "half_width": 0.12,
            **(_OF_FLEET | {"centre": 0.2}),
        },
    ),
    Finding("fleet-assumes", data={"parameters": ["rotor_inertia", "inductance"], "assumed": ["resistance"]}),
    Finding("motors-failed", data={"failed": 1, "rows": 24}),
    Finding("motors-failed", data={"failed": 3, "rows": 1200}),
    Finding("fleet-too-small", data={"motors": 5, "least": 8}),
    Finding("fleet-too-short", data={"periods": 3, "least": 5}),
    Finding("fleet-unfinished", data={"rows": 1200, "asked": 4000}),
    Finding("rows-dropped", data={"dropped": 1}),
    Finding("rows-dropped", data={"dropped": 12}),
)
