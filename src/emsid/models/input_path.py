"""The way of an input into a model: delayed, and brought to the rate of the model's own steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.models.interpolation import INTERPOLATION_REACH, between, interpolated

Array = NDArray[np.float64]


@dataclass(frozen=True)
class InputPath:
    """How a model with one input takes the samples of a record.

    >>> InputPath(delay=1, rate=2, held=True).steps(np.array([3.0, 5.0]))
    array([3., 3., 3., 3.])

    Args:
        delay: nk, samples from the input to its first effect.
        rate: L, how many steps the model makes per sample.
        held: whether the input is held over the steps of a sample; otherwise it is interpolated (band-limited).
    """

    delay: int
    rate: int
    held: bool = False

    @property
    def interpolates(self) -> bool:
        """Whether there are steps between samples, at which the input is interpolated."""
        return self.rate > 1 and not self.held

    @property
    def edge(self) -> int:
        """Samples at the start of a segment for which the interpolated or delayed input is not known."""
        return self.delay + (INTERPOLATION_REACH if self.interpolates else 0)

    @property
    def latency(self) -> int:
        """The delay of the output in samples: interpolation needs the next `INTERPOLATION_REACH` samples.

        It includes the delay of the model.
        """
        return max(INTERPOLATION_REACH - self.delay, 0) if self.interpolates else 0

    @property
    def kept(self) -> int:
        """k, the number of past inputs that the next output needs."""
        return INTERPOLATION_REACH + max(self.delay, INTERPOLATION_REACH) if self.interpolates else self.delay

    def steps(self, u: Array) -> Array:
        """(NL,) an input (N,) at the steps of the model, interpolated and delayed; its first value holds before it."""
        x = np.repeat(u, self.rate) if self.held else interpolated(u, self.rate)
        if self.delay:
            late = min(self.delay * self.rate, len(x))
            x = np.concatenate([np.full(late, u[0]), x[: len(x) - late]])
        return x

    def until(self, u: Array, samples: int) -> tuple[Array, Array]:
        """The input at the steps of the first samples of a segment (N,), `latency` samples less; and its past (k,).

        Before the segment the input is continued point-symmetrically, as for interpolation.
        """
        passed = max(samples - self.latency, 0) * self.rate
        before = 2 * u[0] - u[1 : 1 + max(self.kept - samples, 0)][::-1]
        past = np.concatenate([before, u[:samples]])
        return self.steps(u[: samples + 2 * INTERPOLATION_REACH])[:passed], past[len(past) - self.kept :]

    @property
    def taps(self) -> Array:
        """(L, w) the input at the steps of a sample as sums over the w oldest of its past and present inputs (k + 1,).

        The same as `continued` for one sample.
        """
        if not self.interpolates:
            return np.ones((self.rate, 1))
        taps, reach = np.zeros((self.rate, 2 * INTERPOLATION_REACH + 1)), INTERPOLATION_REACH
        for k, unit in enumerate(np.eye(2 * reach + 1)):
            taps[:, k] = between(unit, self.rate)
        return taps

    def continued(self, past: Array, inputs: Array) -> tuple[Array, Array]:
        """(NL,) the next inputs (N,) at the steps of the model, `latency` samples late; and the past (k,) then."""
        known, samples = np.concatenate([past, inputs]), len(inputs)
        if self.interpolates:
            return between(known[: samples + 2 * INTERPOLATION_REACH], self.rate), known[samples:]
        return np.repeat(known[:samples], self.rate), known[samples:]


@njit(nogil=True)
def enter(taps: Array, past: Array, u: float, steps: Array) -> None:
    """Move the inputs (k + 1,) by one sample, and write the input at its steps (L,); see `InputPath.taps`."""
    for i in range(len(past) - 1):
        past[i] = past[i + 1]
    past[-1] = u
    for step in range(len(taps)):
        total = 0.0
        for i in range(taps.shape[1]):
            total += taps[step, i] * past[i]
        steps[step] = total
