r"""Frequency responses from records: averaged windows (Welch), local polynomials, and periodic inputs.

**Averaged windows.** Spectra are averaged over M Hann windows with half overlap: H = S_zr S_rr⁻¹, with the coherence
γ² = H S_rz/S_zz and cov V = (S_zz − H S_rz) M/(M − nr), S = S_rr⁻¹/M. Leakage remains, which short windows make larger.

**Local polynomials.** At a line k of the transform of a whole segment, the response and the transient, which is what
leaks, are smooth: over 2n + 1 neighbouring lines

    Z(k + d) = [Σₛ Hₛ(k) dˢ] R(k + d) + Σₛ Tₛ(k) dˢ + V(k + d),      s = 0 … 2,

which is linear in its parameters; H₀ is the estimate and the residual gives cov V. Neighbouring estimates share lines:
with h the weights of the centre of such a polynomial, the mean of many estimates has 1/Σh² times the variance that
independent ones would give.

**Regression of spectra.** Every estimate regresses spectra on others, line by line. At every frequency Z = H R + V,
with signals Z (nz,) and a regressor R (nr,) that does not depend on V. In open loop R is the input and Z the output. In
closed loop the input depends on the noise; R is the reference, and Z holds output and input: with H = [H_y; H_u], the
plant is G = H_y H_u⁻¹ (the indirect method), and with V′ = [I, −G] V

    cov G[i, j] = (cov V′)[i, i] · (Qᵀ S Q*)[j, j],      Q = H_u⁻¹,      cov H = cov V ⊗ S.

**Periodic inputs.** The best linear approximation, with its levels of noise and of nonlinear distortion. In steady
state the output repeats with the input. Noise differs between periods; nonlinear distortion repeats, and differs
between realisations: excitations with the same amplitudes and other random phases. With U, Y the transforms of P
periods of M experiments, averaged over the periods, and R those of the reference, or of the input itself,

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
    Welch, *The use of fast Fourier transform for the estimation of power spectra*, IEEE Trans. Audio Electroacoust. 15
    (1967). Bendat, Piersol, *Random Data*, 4th ed. (2010), ch. 9. Pintelon, Schoukens, *System Identification: A
    Frequency Domain Approach*, 2nd ed. (2012), ch. 2 to 4, and 7 on local
    polynomials.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError

SINGULAR = 1e12
"""Condition of the power of several regressors from which they cannot be told apart."""
MOVED = 0.5
"""The share of frequencies at which a reference must move the input by more than its standard error."""


@dataclass(frozen=True, eq=False)
class Regressed:
    """H at F frequencies, with what its covariance is made of.

    Attributes:
        response: (F, nz, nr) H.
        residual: (F, nz, nz) covariance of V.
        spread: (F, nr, nr) S, so that the covariance of H is that of V times S.
    """

    response: Complex
    residual: Complex
    spread: Complex

    def plant(self, inputs: int, closed: bool) -> tuple[Complex, Array]:
        """(F, ny, nu) the response from the inputs, and its variance.

        Args:
            inputs: nu.
            closed: whether the last nu of Z are the inputs and R is the reference; else R holds the inputs.

        Raises:
            DataError: in closed loop, where the reference does not move the inputs.
        """
        if not closed:
            return self.response, variance(self.residual, self.spread)
        of_y, of_u = self.response[:, :-inputs], self.response[:, -inputs:]
        moves = np.any(np.abs(of_u) ** 2 > variance(self.residual[:, -inputs:, -inputs:], self.spread), axis=2)
        if np.mean(np.all(moves, axis=1)) < MOVED or np.any(np.linalg.cond(of_u) > SINGULAR):
            raise DataError(
                "the reference does not move every input, so the response in closed loop cannot be estimated; "
                "excite through the reference, with one for every input"
            )
        inverse = np.linalg.inv(of_u)
        g = of_y @ inverse
        mixed = np.concatenate([np.broadcast_to(np.eye(g.shape[1]), (len(g), g.shape[1], g.shape[1])), -g], axis=2)
        left = mixed @ self.residual @ mixed.conj().swapaxes(1, 2)
        right = inverse.swapaxes(1, 2) @ self.spread @ inverse.conj()
        return g, variance(left, right)


def variance(residual: Complex, spread: Complex) -> Array:
    """(F, nz, nr) the variance of every element of H."""
    one, other = (np.real(np.einsum("fii->fi", each)) for each in (residual, spread))
    return np.asarray(np.maximum(one[:, :, None] * other[:, None, :], 0.0))


def check_told_apart(power: Complex) -> None:
    """Refuse regressors of which one has no power, or follows another, at some frequency.

    Args:
        power: (F, nr, nr) their spectra.

    Raises:
        DataError: for such regressors.
    """
    size = np.sqrt(np.real(np.einsum("fii->fi", power)))
    if not np.all(size > 0) or np.any(np.linalg.cond(power / (size[:, :, None] * size[:, None])) > SINGULAR):
        raise DataError("an input does not change, or follows another at some frequency; leave it out")


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


# --- periodic inputs --------------------------------------------------------------------------------------------------

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
