"""A sensor behind a feedback model: its curve is the first map, and a filter behind that has the last states.

    the loop:      x(t+1) and z by x, u and w of the other maps
    the sensor:    s(t+1) and y by s and w₁ = f₁(z₁)

The loop does not depend on the sensor, and the output depends on the loop through z₁ only, as in a plant whose sensor
is curved, slow, or loses the sign. All other elements of M are zero, and a change of the state mixes those of the loop
or those behind the sensor. So such a model has far fewer parameters than one whose maps may act everywhere.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.terms import check_whole


def absent(states: int, maps: int, sensor: int | None) -> NDArray[np.bool_]:
    """(n + m + 1, n + 1 + m) the elements of M that a sensor makes zero; none without a sensor.

    Args:
        states: n.
        maps: m.
        sensor: how many of the states are behind it.
    """
    n, m = states, maps
    gone = np.zeros((n + m + 1, n + 1 + m), dtype=bool)
    if sensor is not None:
        behind = range(n - sensor, n)
        rows, columns = [*behind, n + m], [*behind, n + 1]
        gone[rows], gone[:, columns] = True, True
        gone[np.ix_(rows, columns)] = False
    return gone


def check_sensor(name: str, states: int, maps: int, sensor: int | None, plain: bool) -> None:
    """Refuse a sensor that a model cannot have.

    Args:
        name: of the model.
        states: n.
        maps: m.
        sensor: how many of the states are behind it.
        plain: whether no map is multiplied by a signal, and no signals are shared.

    Raises:
        ModelError: without a map, with more states behind it than there are, or where the model is not plain.
    """
    if sensor is None:
        return
    check_whole(f"{name}: sensor", sensor, 0, "this is the number of states behind the sensor", states)
    if not maps:
        raise ModelError(f"{name}: a sensor without a map; the first map is its curve")
    if not plain:
        raise ModelError(f"{name}: a sensor, and maps that are multiplied or signals that are shared; leave out either")
