"""How nonlinear the data are, before a nonlinear model is fitted.

Where a multisine is repeated, its periods separate noise from distortion: the noise differs between periods, the
distortion does not, and stands at frequencies that the input does not have (Pintelon and Schoukens). Even distortion
stands at even multiples of the lowest frequency, odd distortion at odd ones. Otherwise the coherence between input and
output shows it, and the test of `dependence`.

References:
    Pintelon, R., and Schoukens, J. (2012). System Identification: A Frequency Domain Approach, 2nd ed., chapter 4.
    Bendat, J. S., and Piersol, A. G. (2010). Random Data, 4th ed., section 6.1: coherence.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.linear.filtering import coherence, spectrum
from emsid.excitation.periods import period_of
from emsid.findings import Finding
from emsid.first_look.baseline import Baseline
from emsid.first_look.dependence import dependence
from emsid.first_look.examined import Response
from emsid.first_look.levels import CHANCE, CLEAR, EXPLAINS, FEW, PART, SAME, SUGGESTS
from emsid.record import Record

Array = NDArray[np.float64]


def nonlinearity(record: Record, response: Response, linear: Baseline | None) -> Iterable[Finding]:
    """At most one finding about how nonlinear the relation between the first input and output is."""
    repeated = distortion_of(record)
    if repeated is not None:
        found, period = repeated
        yield Finding("distortion-levels", record.output_names[0], found.levels() | {"period": period * record.dt})
        return
    if linear is None or response.delay is None:
        return
    share, probability = dependence(linear, record.input[:, 0], record.breaks)
    segment = max(record.segments, key=len)
    of_residual = share / max((1 - linear.fit) ** 2, 1e-12)
    nonlinear = probability < CHANCE and share > SAME**2 and of_residual > PART
    data = {
        "share": share,
        "of_residual": min(of_residual, 1.0),
        "coherence": _coherence(segment.input[:, 0], segment.output[:, 0]),
        "fit_percent": 100 * linear.fit,
        "confidence": round(float(np.clip(0.5 + of_residual if nonlinear else 0.9 - 2 * of_residual, 0.4, 0.95)), 2),
    }
    if nonlinear:
        yield Finding("nonlinear-likely", record.output_names[0], data)
    elif linear.fit >= SUGGESTS:
        because = "little" if of_residual <= PART else "small-error" if probability < CHANCE else "noise"
        yield Finding("nearly-linear", record.output_names[0], data | {"because": because})
    else:
        yield Finding("unexplained-output", record.output_names[0], data | {"input": record.input_names[0]})


def _coherence(u: Array, y: Array) -> float:
    """The part of the power of y (N,) that a linear relation to u (N,) explains, means apart.

    It is the mean of the coherence over frequency, weighted by the power of y: where a smooth input has no power, y has
    none but noise, and the coherence there says nothing about the relation.
    """
    size = min(len(u) // 4, 1024) or 1
    power = spectrum(y, y, size).real[1:]
    explained = np.nan_to_num(coherence(u, y, size)[1:]) * power
    return float(explained.sum() / power.sum()) if power.sum() > 0 else 0.0


@dataclass(frozen=True, eq=False)
class Distortion:
    """The output at the multiples 1, 2, … of the lowest frequency of a periodic input.

    Attributes:
        periods: how many were averaged.
        amplitude: (F,) of the mean period, in the unit of the output.
        noise: (F,) the standard deviation of these amplitudes by noise.
        excited: (F,) whether the input has this frequency.
        band: (F,) whether it is at most three times the highest frequency of the input.
    """

    periods: int
    amplitude: Array
    noise: Array
    excited: NDArray[np.bool_]
    band: NDArray[np.bool_]

    @property
    def even(self) -> NDArray[np.bool_]:
        """(F,) the even multiples without input, where unsymmetric nonlinearities show."""
        even: NDArray[np.bool_] = np.arange(1, len(self.amplitude) + 1) % 2 == 0
        return self.band & ~self.excited & even

    @property
    def odd(self) -> NDArray[np.bool_]:
        """(F,) the odd multiples without input, where symmetric nonlinearities show, such as a dead zone."""
        return self.band & ~self.excited & ~self.even

    def levels(self) -> dict[str, float | int]:
        """Noise of a period, even and odd distortion as shares of the amplitude at the frequencies of the input.

        ``least`` is the smallest distortion that stands out from the noise: the power of one line of noise has as large
        a standard deviation as its mean.
        """
        signal = float(np.sum(self.amplitude[self.excited] ** 2))

        def level(where: NDArray[np.bool_]) -> float:
            power = float(np.sum(self.amplitude[where] ** 2) - np.sum(self.noise[where] ** 2))
            return float(np.sqrt(max(power, 0.0) / signal))

        deviation = max(float(np.linalg.norm(self.noise[where] ** 2)) for where in (self.even, self.odd))
        return {
            "periods": self.periods,
            "noise": float(np.sqrt(np.sum(self.noise[self.band] ** 2) * self.periods / signal)),
            "even": level(self.even),
            "odd": level(self.odd),
            "least": float(np.sqrt(CLEAR * deviation / signal)),
            "lines": int(np.count_nonzero(self.excited)),
        }


def distortion(u: Array, y: Array, period: int) -> Distortion | None:
    """The output at the frequencies of a periodic input and between them; None where noise hides the distortion.

    Args:
        u, y: (N,) input and output.
        period: in samples; the first period is left out as transient where there are three or more.
    """
    count = len(u) // period
    periods = np.reshape(y[len(y) - count * period :], (count, period))
    inputs = np.reshape(u[len(u) - count * period :], (count, period))
    if count >= FEW:
        periods, inputs = periods[1:], inputs[1:]
    count = len(periods)
    drive = np.abs(np.fft.rfft(inputs.mean(axis=0)))[1:]
    lines = 2 / period * np.fft.rfft(periods, axis=1)[:, 1:]
    mean = lines.mean(axis=0)
    variance = np.mean(np.abs(lines - mean) ** 2, axis=0) / (count - 1)  # of the mean of the periods
    excited = drive > 1e-4 * drive.max()
    band = np.arange(len(drive)) <= 3 * np.flatnonzero(excited)[-1]
    found = Distortion(count, np.abs(mean), np.sqrt(variance), excited, band)
    if not np.any(mean[excited]) or np.count_nonzero(band & ~excited) < 4:
        return None
    return found if found.levels()["noise"] <= EXPLAINS else None


def distortion_of(record: Record) -> tuple[Distortion, int] | None:
    """The distortion of the first output of a record with a periodic input, and the period in samples."""
    period = None if record.breaks else period_of(record.input[:, 0])
    found = None if period is None else distortion(record.input[:, 0], record.output[:, 0], period)
    return None if found is None or period is None else (found, period)
