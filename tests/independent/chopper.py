"""A motor behind a bridge that opens all switches in the off-time of its PWM, from period to period.

While the bridge is on, L·di/dt = ±V − R·i − K·ω; while it is off, the current falls against the supply, with −V in the
place of V, and ends at zero. Both are solved exactly with the speed at the start of the period; the speed moves by
small steps of the mean torque, with friction that is smooth around rest:  J·dω/dt = K·ī − T·tanh(ω/ε).
"""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True)
def speed(duty, periods, period, supply, resistance, inductance, constant, inertia, friction, smooth=0.05):  # type: ignore[no-untyped-def]
    """(N,) speed at the samples, from rest, for a duty (N,) from −1 to 1 held over so many periods of the PWM."""
    tau, w, i = inductance / resistance, 0.0, 0.0
    speeds = np.empty(len(duty))
    for t in range(len(duty)):
        speeds[t] = w
        side, share = np.sign(duty[t]), abs(duty[t])
        for _ in range(periods):
            charge = 0.0
            final = (side * supply - constant * w) / resistance
            on = share * period
            charge += final * on + (i - final) * tau * (1.0 - np.exp(-on / tau))
            i = final + (i - final) * np.exp(-on / tau)
            off = period - on
            if i * side > 0.0 and off > 0.0:
                final = (-side * supply - constant * w) / resistance
                off = min(off, tau * np.log(1.0 - i / final)) if i * final < 0.0 else off
                charge += final * off + (i - final) * tau * (1.0 - np.exp(-off / tau))
                i = final + (i - final) * np.exp(-off / tau)
            if share < 1.0 and i * side <= 1e-12:
                i = 0.0
            h = period / 10
            for _ in range(10):
                w += h * (constant * charge / period - friction * np.tanh(w / smooth)) / inertia
    return speeds
