r"""The best linear approximation from periodic inputs, with its levels of noise and of nonlinear distortion.

In steady state the output repeats with the input. Noise differs between periods; nonlinear distortion repeats, and
differs between realisations: excitations with the same amplitudes and other random phases. With U, Y the transforms of
P periods of M experiments, averaged over the periods, and R those of the reference, or of the input itself,

    G = Y Q,      Q = Rᴴ (U Rᴴ)⁻¹,      V = Y − G U,      var G[i, j] = (cov V)[i, i] Σₘ|Q[m, j]|²,

which for one input is the mean of Y over that of U. The scatter of V between periods gives the covariance by noise. The
covariance by noise and distortion together is given

- by the scatter of V between experiments (the *robust method*), if there are more of them than inputs;
- for as many experiments as inputs by the lines within the band that are not excited (the *fast method*): what stands
  there beyond noise is distortion, at even lines by even and at odd ones by odd nonlinearities. With only odd lines
  excited, those odd lines left out (detection lines) show what disturbs the response, and the even ones what does not.

A scatter is averaged over so many neighbouring lines that it has `ENOUGH` degrees of freedom, as a fit weighted with it
needs: with weights of ν degrees of freedom, its variance grows by about 2/ν.

References:
    Pintelon, Schoukens, *System Identification: A Frequency Domain Approach*, 2nd ed. (2012), ch. 3 and 4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError
from emsid.estimation.frequency.regressed import SINGULAR

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

EXCITED = 1e-4
"""Lines with less power than this part of the strongest one's are not excited."""
ENOUGH = 50
"""Degrees of freedom of a scatter, with its real and imaginary parts."""
DETECTING = 9
"""Neighbouring lines without input that a level is averaged over. Per line it is off by 1.3 dB (rms), for a cubic map
before a resonance and for one behind it; 25 lines smear a resonance (2.2 dB), 5 scatter more (1.7 dB)."""


@dataclass(frozen=True, eq=False)
class BestLinear:
    """The best linear approximation at F excited lines.

    Attributes:
        lines: (F,) multiples of the lowest frequency.
        response: (F, ny, nu).
        noise: (F, ny, nu) variance by noise; None for one period.
        total: (F, ny, nu) variance by noise and distortion; None where neither more experiments than inputs nor lines
            without input show it.
        even: (F, ny, nu) variance by even distortion, of the fast method.
        output: (M, L, ny) the mean output of every experiment at all L multiples of the lowest frequency; at lines that
            are not excited, less what the response explains.
        scatter: (L, ny) the variance by noise of these means; None for one period.
    """

    lines: NDArray[np.intp]
    response: Complex
    noise: Array | None
    total: Array | None
    even: Array | None
    output: Complex
    scatter: Array | None


def best_linear(inputs: Sequence[Array], outputs: Sequence[Array], references: Sequence[Array]) -> BestLinear:
    """The best linear approximation from whole periods in steady state.

    Args:
        inputs: (P, N, nu) of every experiment: P periods of N samples.
        outputs: (P, N, ny) likewise.
        references: (P, N, nr) likewise; the inputs themselves in open loop.

    Raises:
        DataError: for fewer experiments than inputs, or where they do not excite all inputs at any line.
    """
    u, y, r = ([np.fft.rfft(each, axis=1)[:, 1:] for each in several] for several in (inputs, outputs, references))
    mean_u, mean_y, mean_r = (np.array([each.mean(axis=0) for each in several]) for several in (u, y, r))  # (M, F, n)
    count, wanted = len(u), mean_u.shape[2]
    if count < wanted:
        raise DataError(f"{count} experiments for {wanted} inputs; give one for every input at least")
    lines = _excited(mean_r)
    at_u, at_y, at_r = (each[:, lines].transpose(1, 2, 0) for each in (mean_u, mean_y, mean_r))  # (F, n, M)
    against = at_r.conj().swapaxes(1, 2)
    moved = at_u @ against
    if moved.shape[1] != moved.shape[2] or np.any(np.linalg.cond(moved) > SINGULAR):
        raise DataError(
            "the experiments do not excite every input in another way; give as many experiments with other phases as "
            "there are inputs, and in closed loop one reference for every input, which moves it"
        )
    q = against @ np.linalg.inv(moved)
    g = at_y @ q
    spread = np.sum(np.abs(q) ** 2, axis=1)  # (F, nu)

    def levels(power: Array) -> Array:
        return np.asarray(power[:, :, None] * spread[:, None, :])

    whole = _everywhere(g, lines, mean_u.shape[1])
    left = [b - np.einsum("fij,pfj->pfi", whole, a) for a, b in zip(u, y, strict=True)]  # V (P, F, ny) at all lines
    mean = np.array([each.mean(axis=0) for each in left])  # (M, F, ny)
    freedom = sum(len(each) - 1 for each in left)
    noise = None
    if freedom:
        scatter = sum(np.sum(np.abs(each - each.mean(axis=0)) ** 2, axis=0) for each in left)
        share = np.mean([1 / len(each) for each in left])  # of the mean over periods
        noise = _averaged(np.asarray(scatter) / freedom * share, -(-ENOUGH // (2 * freedom)))  # at all lines
    total, even = None, None
    if count > wanted:
        power = np.sum(np.abs(mean[:, lines]) ** 2, axis=0) / (count - wanted)
        total = levels(_averaged(power, -(-ENOUGH // (2 * (count - wanted)))))
    elif (found := _detected(mean, noise, lines)) is not None:
        odd, even = (levels(each) for each in found)
        total = odd if np.all((lines + 1) % 2) else odd + even
    mean[:, lines] = mean_y[:, lines]
    return BestLinear(lines + 1, g, None if noise is None else levels(noise[lines]), total, even, mean, noise)


def _excited(r: Complex) -> NDArray[np.intp]:
    """The lines at which the experiments (M, F, nr) excite all references."""
    power = np.sum(np.abs(r) ** 2, axis=0)
    largest = power.max(axis=0)
    if not np.all(largest > 0):
        raise DataError("an input is constant and excites nothing; use a record in which it moves")
    return np.flatnonzero(np.all(power > EXCITED * largest, axis=1))


def _everywhere(g: Complex, lines: NDArray[np.intp], count: int) -> Complex:
    """The response at all lines, interpolated between the excited ones."""
    found = np.empty((count, *g.shape[1:]), dtype=complex)
    for i, j in np.ndindex(*g.shape[1:]):
        real, imaginary = (np.interp(np.arange(count), lines, part[:, i, j]) for part in (g.real, g.imag))
        found[:, i, j] = real + 1j * imaginary
    return found


def _detected(mean: Complex, noise: Array | None, lines: NDArray[np.intp]) -> tuple[Array, Array] | None:
    """(F, ny) the power at the excited lines of noise and odd distortion, and of even distortion alone."""
    band = np.arange(lines[0], lines[-1] + 1)
    silent = np.setdiff1d(band, lines)
    power = np.mean(np.abs(mean) ** 2, axis=0)
    base = np.zeros_like(power) if noise is None else noise
    found = []
    for parity in (0, 1):  # line k is the multiple k + 1: odd multiples first
        where = silent[silent % 2 == parity]
        if not len(where):
            if parity == 0:
                return None
            found.append(np.zeros((len(lines), power.shape[1])))
            continue
        smooth = _averaged(power[where] - base[where], DETECTING)
        found.append(np.maximum(np.array([np.interp(lines, where, column) for column in smooth.T]).T, 0.0))
    odd, even = found
    return odd + base[lines], even


def _averaged(power: Array, many: int) -> Array:
    """(F, n) levels averaged over so many neighbours, and one more for an even number."""
    half = min(many // 2, (len(power) - 1) // 2)
    sums = np.concatenate([np.zeros((1, power.shape[1])), np.cumsum(power, axis=0)])
    first = np.clip(np.arange(len(power)) - half, 0, len(power) - 2 * half - 1)
    return np.asarray((sums[first + 2 * half + 1] - sums[first]) / (2 * half + 1))
