"""Whether the plant moves in some records: a search over records without motion would return meaningless numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError
from emsid.estimation.linear.filtering import filtered
from emsid.record import Record

Array = NDArray[np.float64]


def check_motion(segments: Sequence[Record]) -> None:
    """Refuse records with a constant input, a constant output, or an output that is only noise."""
    first = segments[0]
    for names, side in ((first.input_names, "input"), (first.output_names, "output")):
        values = [getattr(segment, side) for segment in segments]
        together = [np.concatenate(values)] if side == "input" else values  # of several steps each may have its level
        if not any(np.ptp(v, axis=0).any() for v in together):
            what = "nothing drives it" if side == "input" else "nothing moves"
            raise DataError(
                f"{first.name}: {side} {', '.join(names)} stays at {values[0][0, 0]:g} throughout; {what}, "
                "and no parameter can be found from it"
            )
    if all(_is_noise(segments, channel) for channel in range(len(first.output_names))):
        raise DataError(
            f"{first.name}: output {', '.join(first.output_names)} is noise that has nothing to do with the input; "
            "nothing moves, and no parameter can be found from it"
        )


CHANCE = 0.05
"""The chance that noise passes for motion, by either of two tests; a weak motion must not pass for noise."""
SETTLING = (0.0, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
"""Time constants in samples of possible responses to an input."""


def _is_noise(segments: Sequence[Record], channel: int) -> bool:
    """Whether an output is white (Ljung, Box, Biometrika 65, 1978) and uncorrelated with responses to the input."""
    from scipy.special import chdtrc

    lags = 20
    long = [segment for segment in segments if len(segment) > 2 * lags]
    if not long:
        return False

    def centred(signals: Sequence[Array]) -> list[Array]:
        mean = np.mean(np.concatenate(signals))
        return [signal - mean for signal in signals]

    def correlation(x: Sequence[Array], y: Sequence[Array]) -> float:
        size = np.sqrt(sum(float(a @ a) for a in x) * sum(float(b @ b) for b in y))
        return sum(float(a @ b) for a, b in zip(x, y, strict=True)) / size if size > 0 else 0.0

    y = centred([segment.output[:, channel] for segment in long])
    samples = sum(len(piece) for piece in y)
    colour = sum(correlation([p[:-lag] for p in y], [p[lag:] for p in y]) ** 2 for lag in range(1, lags + 1))
    if chdtrc(lags, samples * colour) < CHANCE:
        return False
    inputs = [centred([segment.input[:, k] for segment in long]) for k in range(long[0].input.shape[1])]
    decays = [np.exp(-1 / time) if time else 0.0 for time in SETTLING]
    answers = [correlation([filtered(1.0, [1.0, -d], p) for p in u], y) ** 2 for u in inputs for d in decays]
    return bool(chdtrc(1, samples * max(answers)) > CHANCE / len(answers))
