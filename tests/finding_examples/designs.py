"""Findings on designed experiments."""

from emsid.findings import Finding

_CONSTANTS = ["resistance", "motor_constant", "rotor_inertia"]
EXAMPLES = (
    Finding("not-separable", "rigid-motor", {"names": _CONSTANTS, "directions": 1, "remedies": ["current", "inertia"]}),
    Finding("not-separable", "rigid-motor", {"names": _CONSTANTS, "directions": 2, "remedies": []}),
    Finding("design-gains-nothing", "rigid-motor", {"signal": "ramp"}),
)
