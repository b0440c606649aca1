"""How nonlinear the data are, before a nonlinear model is fitted.

Where a multisine is repeated, its periods separate noise from distortion: the noise differs between periods, the
distortion does not, and stands at frequencies that the input does not have (`estimation.frequency.periodic`). Even
distortion stands at even multiples of the lowest frequency, odd distortion at odd ones. Otherwise two measures show it:
the coherence between input and output (Bendat and Piersol, section 6.1), and a test of the residual of a linear model
(`dependence`).

**The test.** Whether the residual of a linear model depends on nonlinear functions of the input is an F test of two
nested regressions of the residual: on straight functions S, which are the derivatives of the linear model by its
coefficients, and on [S C] with curved ones C of the input and of the simulated output (Davidson and MacKinnon,
section 6.7). If the system is linear, C explains no more of the residual than as many columns explain of noise.

**Coloured noise.** The residual lasts long in slow systems, so its samples are not independent. Residual and columns
are therefore filtered by an autoregression A(q) that whitens the noise (generalised least squares, Davidson and
MacKinnon, section 7.4). The noise is what a regression leaves of the residual. A regression on [S C] also takes slow
noise out of it, and one on S leaves a part of what is not noise. So both give an A(q), each is estimated again from
what the filtered regression leaves, and the most likely is taken by the restricted likelihood, which allows for what
the columns take out (Patterson and Thompson).

**Noise that wanders.** The estimates of A(q) are stable, and near a root at one they are poor. Noise that wanders, as a
random walk does, gives A(q) = (1 − q⁻¹)·B(q), where B(q) is estimated from differences. The constant in S is zero
there. The restricted likelihood of the samples does not depend on the constant, so it is one of differences too, and
both can be compared.

References:
    Bendat, Piersol, *Random Data*, 4th ed. (2010). Davidson, MacKinnon, *Econometric Theory and Methods* (2004).
    Patterson, Thompson, *Recovery of inter-block information when block sizes are unequal*, Biometrika 58 (1971).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import fdtrc

from emsid.estimation.frequency import best_linear
from emsid.estimation.linear.filtering import coherence, filtered, spectrum
from emsid.estimation.uncertainty.coloured_residuals import MOST_POLES, autoregression
from emsid.excitation.periods import period_of, settled_periods, whole_periods
from emsid.findings import Finding
from emsid.first_look.baseline import Baseline
from emsid.first_look.examined import Response
from emsid.first_look.levels import CHANCE, CLEAR, EXPLAINS, FEW, PART, SAME, SAMPLES, SUGGESTS
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
        amplitude: (F,) of the mean period, in the unit of the output; without input, of what no linear relation
            explains.
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
        period: in samples; the first period is left out where it is a transient.
    """
    count = settled_periods(y, period)
    inputs, outputs = (whole_periods(each[:, None], period)[-count:] for each in (u, y))
    linear = best_linear([inputs], [outputs], [inputs])
    if linear.scatter is None:
        return None
    amplitude, noise = 2 / period * np.abs(linear.output[0, :, 0]), 2 / period * np.sqrt(linear.scatter[:, 0])
    excited = np.zeros(len(amplitude), dtype=bool)
    excited[linear.lines - 1] = True
    band = np.arange(1, len(amplitude) + 1) <= 3 * linear.lines[-1]
    found = Distortion(count, amplitude, noise, excited, band)
    if not np.any(amplitude[excited]) or np.count_nonzero(band & ~excited) < 4:
        return None
    return found if found.levels()["noise"] <= EXPLAINS else None


def distortion_of(record: Record) -> tuple[Distortion, int] | None:
    """The distortion of the first output of a record with a periodic input, and the period in samples."""
    period = None if record.breaks else period_of(record.input[:, 0])
    found = None if period is None else distortion(record.input[:, 0], record.output[:, 0], period)
    return None if found is None or period is None else (found, period)


DELAYS = (-32, -16, -8, -4, -2, -1, 0, 1, 2, 4, 8, 16, 32)
"""The delays of the straight functions, in samples from the delay of the linear model."""
FARTHEST = 0.01
"""They are no farther from it than this share of the samples."""
RANK = 1e-5
"""A function of which others leave less than this is described by them."""
REPETITIONS = 2
"""How often the noise is estimated, each time from what the filtered regression leaves."""


class Dependence(NamedTuple):
    """How much of the residual of a linear model depends on nonlinear functions.

    Attributes:
        share: of the output's variance, less what as many functions explain of noise alone.
        probability: of at least as much in noise, if the system is linear; one where the samples are too few.
    """

    share: float
    probability: float


def dependence(linear: Baseline, u: Array, breaks: Sequence[int]) -> Dependence:
    """Test whether nonlinear functions explain the residual of a linear model better than linear ones do.

    Args:
        linear: the model.
        u: (N,) input.
        breaks: the first sample of every segment but the first; at most `SAMPLES` from the middle are tested.
    """
    start = max((len(u) - SAMPLES) // 2, 0)
    here = slice(start, start + SAMPLES)
    edges = [edge - start for edge in breaks if start < edge < start + SAMPLES]
    straight, curved = _columns(linear, linear.simulated[here], u[here], edges)
    every, few = len(straight) + len(curved), len(straight)
    table = np.column_stack([*straight, *curved, linear.residual[here]])
    pieces = [piece for piece in np.split(table, edges) if len(piece) > 2 * MOST_POLES]
    if sum(map(len, pieces)) < FEW * every or not np.any(linear.residual[here]):
        return Dependence(0.0, 1.0)
    for independent in (_independent, _independent_in_differences):
        kept = independent(pieces)
        few, every = int(np.count_nonzero(kept < few)), len(kept)
        pieces = [piece[:, [*kept, -1]] for piece in pieces]
    if few == every:
        return Dependence(0.0, 1.0)
    weighted = [*_weighted(pieces, few, every), *_weighted(_differences(pieces), few - 1, every - 1)]
    ratio, probability = min(weighted, key=lambda each: each.criterion).test
    squares = Regression(pieces, np.ones(1), few).triangle[:, -1] ** 2
    explained = float(squares[few:-1].sum() / squares.sum())
    of_noise = 1 / ratio if ratio > 1 else 1.0
    return Dependence(explained * (1 - of_noise) * (1 - linear.fit) ** 2, probability)


def _columns(linear: Baseline, simulated: Array, u: Array, breaks: Sequence[int]) -> tuple[list[Array], list[Array]]:
    """The straight and the curved functions of the input that may explain the residual of a linear model.

    The straight ones are the derivatives of the model by its coefficients: the input at delays around that of the
    model, as it is and through 1/A(q), and the simulated output. The curved ones are the square, the cube, the sign and
    the small values of the simulated output and of the delayed input, as they are and as they pass through the linear
    model: friction acts where the input does. A further one is the simulated output while the input is zero, since a
    drive that coasts slows down more slowly.
    """
    around = [each for each in DELAYS if abs(each) <= FARTHEST * len(u)]
    lagged = {lag: _delayed(u, lag, breaks) for lag in (max(linear.delay + each, 0) for each in around)}
    straight = [np.ones(len(u)), *lagged.values(), *(linear.summed(each, breaks) for each in lagged.values())]
    curved = []
    for x in (simulated, lagged[linear.delay]):
        scaled = (x - x.mean()) / (x.std() or 1.0)
        size = x / (np.max(np.abs(x)) or 1.0)
        functions = [scaled**2, scaled**3, np.sign(x), np.clip(size, -0.1, 0.1)]
        straight += [scaled, linear.answer(scaled, breaks)]
        curved += [*functions, *(linear.answer(each, breaks) for each in functions)]
    inner = lagged[linear.delay]
    coasting = np.where(np.abs(inner) <= SAME * np.max(np.abs(inner)), simulated, 0.0)
    return straight, [*curved, coasting, linear.answer(coasting, breaks)]


def _delayed(x: Array, delay: int, breaks: Sequence[int]) -> Array:
    """(N,) a signal this many samples later; before, it is the first sample of its segment."""
    pieces = np.split(x, list(breaks))
    return np.concatenate([np.r_[np.full(min(delay, len(p)), p[0]), p[: max(len(p) - delay, 0)]] for p in pieces])


def _independent(pieces: Sequence[Array]) -> NDArray[np.intp]:
    """The columns of tables (Nᵢ, p + 1) that no earlier ones describe, the last one left out."""
    columns = np.concatenate([piece[MOST_POLES:, :-1] for piece in pieces])
    size = np.sqrt(np.sum(columns**2, axis=0))
    triangle = np.linalg.qr(columns / np.where(size > 0, size, 1.0), mode="r")
    return np.flatnonzero(np.abs(np.diag(triangle)) > RANK)


def _independent_in_differences(pieces: Sequence[Array]) -> NDArray[np.intp]:
    """Columns with independent differences from row to row, and the constant: some are constant in every segment."""
    return np.concatenate([[0], 1 + _independent(_differences(pieces))])


def _weighted(pieces: Sequence[Array], few: int, every: int) -> Iterator[Regression]:
    """The regressions filtered by every estimate of A(q)."""
    plain = Regression(pieces, np.ones(1), few)
    for known in (few, every):
        noise = plain.left(pieces, known)
        for _ in range(REPETITIONS):
            weighted = Regression(pieces, autoregression(noise)[0], few)
            yield weighted
            noise = weighted.left(pieces, every)


def _differences(pieces: Sequence[Array]) -> list[Array]:
    """Tables of differences from row to row, without the constant, which is the first column.

    Regressions on them have a column less than on the tables, so they get a row less, in the first table; the first row
    of the others is zero.
    """
    return [np.diff(piece[:, 1:], axis=0, prepend=piece[: min(k, 1), 1:]) for k, piece in enumerate(pieces)]


class Regression:
    """The nested regressions of a residual on [S] and on [S C], all of them filtered by A(q).

    Args:
        pieces: (Nᵢ, p + 1) columns and residual, segment by segment.
        polynomial: A(q); the first `MOST_POLES` samples of every segment start the filter.
        few: the number of columns of S.

    Attributes:
        triangle: (p + 1, p + 1) the triangular factor of the filtered columns and residual.
    """

    def __init__(self, pieces: Sequence[Array], polynomial: Array, few: int) -> None:
        table = np.concatenate([filtered(polynomial, 1.0, piece.T).T[MOST_POLES:] for piece in pieces])
        self.triangle = np.asarray(np.linalg.qr(table, mode="r"))
        self._poles, self._samples, self._few = len(polynomial) - 1, len(table), few

    def left(self, pieces: Sequence[Array], known: int) -> list[Array]:
        """(Nᵢ,) what the estimate by the first ``known`` columns leaves of the residual, which is not filtered."""
        estimate = solve_triangular(self.triangle[:known, :known], self.triangle[:known, -1])
        return [piece[:, -1] - piece[:, :known] @ estimate for piece in pieces]

    @property
    def criterion(self) -> float:
        """Schwarz's criterion of A(q) by the restricted likelihood: (N − p)·log RSS + log|ZᵀZ| + n·log N."""
        sizes = 2 * np.log(np.maximum(np.abs(np.diag(self.triangle)), np.finfo(float).tiny))
        freedom = self._samples - len(sizes) + 1
        return float(freedom * sizes[-1] + sizes[:-1].sum() + self._poles * np.log(self._samples))

    @property
    def test(self) -> tuple[float, float]:
        """The F ratio of both regressions, and the probability of at least that in noise."""
        squares = self.triangle[:, -1] ** 2
        functions, freedom = len(squares) - 1 - self._few, self._samples - len(squares) + 1
        ratio = float(np.mean(squares[self._few : -1]) / max(squares[-1] / freedom, np.finfo(float).tiny))
        return ratio, float(fdtrc(functions, freedom, ratio))
