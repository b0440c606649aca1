"""The way of an input into a model: delayed, and held or interpolated to the rate of the model's own steps."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit

Array = NDArray[np.float64]

# Interpolation between samples uses this many samples on either side.
INTERPOLATION_REACH = 16
# The shape of the window: the stop band of the low-pass is 90 dB below its pass band.
KAISER = 9.0


def interpolated(u: Array, factor: int) -> Array:
    """(N·factor,) the band-limited signal through samples u (N,), continued point-symmetrically at its ends.

    Within `INTERPOLATION_REACH` samples of an end it is an extrapolation. The result is cached and read-only, because a
    search needs the same one thousands of times.
    """
    return u if factor == 1 else _interpolated(np.asarray(u, dtype=float).tobytes(), factor)


def between(u: Array, factor: int) -> Array:
    """((N − 2·reach)·factor,) the band-limited signal through samples u (N,), from the sample ``reach`` on.

    ``reach`` is `INTERPOLATION_REACH`: the samples at either end only support the interpolation. Every one of the
    ``factor`` values in a sample interval is the convolution with a part of the low-pass of its own (polyphase form).
    """
    low_pass = _low_pass(factor)
    parts = [np.convolve(u[min(k, 1) :], low_pass[k::factor], "valid") for k in range(factor)]
    return np.column_stack(parts).reshape(-1)


@lru_cache(maxsize=64)
def _interpolated(samples: bytes, factor: int) -> Array:
    u, reach = np.frombuffer(samples), INTERPOLATION_REACH
    around = np.pad(u, reach, "reflect", reflect_type="odd") if len(u) > reach else np.pad(u, reach, "edge")
    fine = between(around, factor)
    fine.flags.writeable = False
    return fine


@lru_cache
def _low_pass(factor: int) -> Array:
    """(2·reach·factor + 1,) the ideal low-pass in a Kaiser window, with the sum ``factor``."""
    half = INTERPOLATION_REACH * factor
    taps = np.sinc(np.arange(-half, half + 1) / factor) * np.kaiser(2 * half + 1, KAISER)
    scaled: Array = taps * factor / taps.sum()
    return scaled


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
