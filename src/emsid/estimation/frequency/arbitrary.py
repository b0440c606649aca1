r"""Frequency responses from arbitrary inputs: averaged windows (Welch), and local polynomials.

**Averaged windows.** Spectra are averaged over M Hann windows with half overlap: H = S_zr S_rr⁻¹, with the coherence
γ² = H S_rz/S_zz and cov V = (S_zz − H S_rz) M/(M − nr), S = S_rr⁻¹/M. Leakage remains, which short windows make larger.

**Local polynomials.** At a line k of the transform of a whole segment, the response and the transient, which is what
leaks, are smooth: over 2n + 1 neighbouring lines

    Z(k + d) = [Σₛ Hₛ(k) dˢ] R(k + d) + Σₛ Tₛ(k) dˢ + V(k + d),      s = 0 … 2,

which is linear in its parameters; H₀ is the estimate and the residual gives cov V. Neighbouring estimates share lines:
with h the weights of the centre of such a polynomial, the mean of many estimates has 1/Σh² times the variance that
independent ones would give.

References:
    Welch, *The use of fast Fourier transform for the estimation of power spectra*, IEEE Trans. Audio Electroacoust. 15
    (1967). Bendat, Piersol, *Random Data*, 4th ed. (2010), ch. 9. Pintelon, Schoukens, *System Identification: A
    Frequency Domain Approach*, 2nd ed. (2012), ch. 7: local polynomials.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError
from emsid.estimation.frequency.regressed import Regressed, check_told_apart

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

INDEPENDENT = 36 / 38
"""Independent averages per Hann window at an overlap of one half, whose neighbours correlate by 1/6."""
NEIGHBOURS = 1 + 2 * (4 / 9 + 1 / 36)
"""Lines of a Hann window that share data: neighbours correlate by 2/3, and those after them by 1/6."""
DEGREE = 2
"""Of the local polynomials; less bends at a resonance, more leaves more noise."""
AT_ONCE = 4096
"""Frequencies of which the local problems are solved at once."""


def windows(segments: Sequence[Array], size: int) -> Iterator[Array]:
    """The pieces (size, n) of signals (N, n) that overlap by half, without their means, under a Hann window."""
    taper = np.sin(np.pi * np.arange(size) / size)[:, None] ** 2
    for x in segments:
        for k in range(0, len(x) - size + 1, max(size - size // 2, 1)):
            piece = x[k : k + size]
            yield (piece - piece.mean(axis=0)) * taper


def welch(regressors: Sequence[Array], signals: Sequence[Array], size: int) -> tuple[Regressed, Array]:
    """H at the lines 1, 2, … of a window, and the coherence (F, nz).

    Args:
        regressors: (N, nr) of every segment.
        signals: (N, nz) likewise.
        size: samples of a window.

    Raises:
        DataError: for too few windows, or regressors that cannot be told apart.
    """
    count = regressors[0].shape[1]
    both = [np.hstack(pair) for pair in zip(regressors, signals, strict=True)]
    products, averages = np.zeros((1, 1, 1), dtype=complex), 0
    for piece in windows(both, size):
        x = np.fft.rfft(piece, axis=0)[1:]
        products = products + x[:, :, None] * x[:, None].conj()
        averages += 1
    if averages <= count:
        raise DataError(f"{averages} windows for {count} inputs; give a shorter window or a longer record")
    return from_powers(np.asarray(products / averages), count, averages * INDEPENDENT)


def from_powers(products: Complex, count: int, averages: float | Array) -> tuple[Regressed, Array]:
    """H and the coherence from spectra (F, nr + nz, nr + nz) that are means of so many independent ones."""
    rr, zr, zz = products[:, :count, :count], products[:, count:, :count], products[:, count:, count:]
    check_told_apart(rr)
    inverse = np.linalg.inv(rr)
    response = zr @ inverse
    explained = response @ zr.conj().swapaxes(1, 2)
    power, linear = (np.real(np.einsum("fii->fi", each)) for each in (zz, explained))
    coherence = np.clip(np.divide(linear, power, out=np.zeros_like(power), where=power > 0), 0.0, 1.0)
    many = np.broadcast_to(np.asarray(averages, dtype=float), len(rr))[:, None, None]
    residual = (zz - explained) * (many / np.maximum(many - count, 1.0))
    return Regressed(response, residual, inverse / many), coherence


def half_width(regressors: int) -> int:
    """n of a window of 2n + 1 lines with about twice as many lines as parameters."""
    return (DEGREE + 1) * (regressors + 1)


def shared(half: int) -> float:
    """How many neighbouring estimates share the same data: 1/Σh²."""
    weights = np.linalg.pinv(np.vander(np.arange(-half, half + 1) / half, DEGREE + 1, increasing=True))[0]
    return float(1 / np.sum(weights**2))


def local_polynomials(regressors: Sequence[Array], signals: Sequence[Array]) -> tuple[Array, Regressed]:
    """Frequencies (F,) in cycles per sample and H there: at the lines of the longest segment.

    Shorter segments have fewer lines, whose polynomials are evaluated at the same frequencies; every segment counts by
    the power that its regressors have there.

    Args:
        regressors: (N, nr) of every segment.
        signals: (N, nz) likewise.

    Raises:
        DataError: for segments that are too short, or regressors that cannot be told apart.
    """
    count = regressors[0].shape[1]
    half, longest = half_width(count), max(map(len, regressors))
    least = 2 * (2 * half + 3)
    used = [k for k, r in enumerate(regressors) if len(r) >= least]
    if not used:
        raise DataError(f"a frequency response by local polynomials needs {least} samples; the longest has {longest}")
    f = np.arange(1, (longest + 1) // 2) / longest
    found = [_of_segment(regressors[k], signals[k], f, half) for k in used]
    if len(found) == 1:
        return f, found[0]
    weights = np.array([np.linalg.inv(each.spread) for each in found])
    spread = np.linalg.inv(np.sum(weights, axis=0))
    response = np.sum(np.array([each.response for each in found]) @ weights, axis=0) @ spread
    return f, Regressed(response, np.mean(np.array([each.residual for each in found]), axis=0), spread)


def _of_segment(r: Array, z: Array, f: Array, half: int) -> Regressed:
    samples, count = r.shape
    scale = np.sqrt(samples)
    of_r, of_z = np.fft.rfft(r - r.mean(axis=0), axis=0) / scale, np.fft.rfft(z - z.mean(axis=0), axis=0) / scale
    size = np.sqrt(np.mean(np.abs(of_r[1:]) ** 2, axis=0))
    if not np.all(size > 0):
        raise DataError("an input does not change, or follows another at some frequency; leave it out")
    of_r = of_r / size
    parts = []
    for start in range(0, len(f), AT_ONCE):
        at = f[start : start + AT_ONCE] * samples
        first = np.clip(np.rint(at).astype(int) - half, 1, max((samples + 1) // 2 - 2 * half - 1, 1))
        lines = first[:, None] + np.arange(2 * half + 1)
        power = ((lines - at[:, None]) / half)[:, :, None] ** np.arange(DEGREE + 1)
        whole = np.concatenate([(power[:, :, :, None] * of_r[lines][:, :, None]).reshape(*lines.shape, -1), power], 2)
        q, triangle = np.linalg.qr(whole)
        if np.any(np.linalg.cond(triangle) > 1 / np.finfo(float).eps):
            raise DataError(
                "an input repeats, has no power in some band, or follows another there; leave it out, or average "
                "periods or windows instead"
            )
        centre = (np.linalg.inv(triangle) @ q.conj().swapaxes(1, 2))[:, :count]
        values = of_z[lines]
        left = values - q @ (q.conj().swapaxes(1, 2) @ values)
        degrees = lines.shape[1] - whole.shape[2]
        residual = left.swapaxes(1, 2) @ left.conj() / degrees
        parts.append(((centre @ values).swapaxes(1, 2) / size, residual, centre.conj() @ centre.swapaxes(1, 2)))
    response, residual, spread = (np.concatenate(each) for each in zip(*parts, strict=True))
    return Regressed(response, residual, spread / np.outer(size, size))
