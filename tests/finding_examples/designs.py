"""Findings on designed experiments."""

from emsid.findings import Finding

_CONSTANTS = ["resistance", "motor_constant", "rotor_inertia"]
EXAMPLES = (
    Finding("not-separable", "rigid-motor", {"names": _CONSTANTS, "directions": 1, "remedies": ["current", "inertia"]}),
    Finding("not-separable", "rigid-motor", {"names": _CONSTANTS, "directions": 2, "remedies": []}),
    Finding(
        "design-determines",
        "brushless",
        {"names": ["flux", "inertia"], "shares": [0.01, 0.018], "left": ["viscous_friction"]},
    ),
    Finding("design-assumes", "brushless", {"ranges": [["flux", 0.0044, 0.0066, "Wb"]]}),
    Finding("design-gains-nothing", "rigid-motor", {"signal": "ramp"}),
)
