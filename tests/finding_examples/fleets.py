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
    Finding("fleet-assumes", data={"parameters": ["rotor_inertia", "inductance"], "assumed": ["resistance"]}),
    Finding("motors-failed", data={"failed": 1, "rows": 24}),
    Finding("motors-failed", data={"failed": 3, "rows": 1200}),
    Finding("fleet-too-small", data={"motors": 5, "least": 8}),
    Finding("fleet-unfinished", data={"rows": 1200, "asked": 4000}),
    Finding("rows-dropped", data={"dropped": 1}),
    Finding("rows-dropped", data={"dropped": 12}),
)
