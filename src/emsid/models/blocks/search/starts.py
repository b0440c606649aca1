r"""Automatic start values for cascades.

The free-run cost of a cascade has many minima, and the start decides which one a search reaches. Three sources give
candidates, each in its own function; `scanned` scores every candidate by one linear problem (`trials`), and
`fit_cascade` refines the best.

**The best linear approximation.** Driven by a random input, filter–map–filter looks like the product of its two
filters, up to a gain (Bussgang's theorem; Schoukens & Tiels 2017). So a rational function is fitted to the measured
frequency response, and its poles and zeros are divided between the two filters in every way that gives the required
orders; conjugate pairs stay together. The response shows zeros beyond the band of the input only roughly; so the
poles and zeros of a refined cascade are divided anew, and a sample of delay is moved between its filters.

**The paper's least-squares solution.** The expanded regression (5.8) has the parameters s = d ⊗ (b₁, λ₂b₁²), a matrix
of rank one with delays as rows and powers as columns. The leading singular vectors of its least-squares estimate are
the numerator d of the second filter and (λ₁b₁, λ₂b₁², …) of the map.

**Sign recovery.** For the map |x|, `sign_recovery` estimates the lost signs of the output, and the first filter is
fitted to the signed signal. Its constant gives the input at which the signal is zero, which is the kink; it is part of
the start.

References:
    Schoukens, Tiels, *Identification of block-oriented nonlinear systems starting from linear approximations: a
    survey*, Automatica 85 (2017). Sjöberg, Schoukens, *Initializing Wiener–Hammerstein models based on partitioning of
    the best linear approximation*, Automatica 48 (2012). Kara, Abokoos, eqs. (5.1) to (5.11).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import islice, product

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.linear.least_squares import gather
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.nonlinear.rational import fit_rational
from emsid.models.blocks.block import Block
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.fitting import search
from emsid.models.blocks.gain import unit_gain
from emsid.models.blocks.search.sign_recovery import recovered_signals
from emsid.models.blocks.search.trials import TRIAL_SAMPLES, Filters, of_unit_gain
from emsid.models.blocks.static_maps import Polynomial, StaticMap
from emsid.models.one_channel import Segments
from emsid.models.regression.structures import wiener_hammerstein_regression
from emsid.record import FrequencyResponse, Record

Array = NDArray[np.float64]

# The largest number of divisions of poles and zeros that are tried.
MOST_SPLITS = 2_000
# The largest number of sign sequences that give candidates.
MOST_SIGN_SEQUENCES = 3
# Frequencies in cycles per sample at which filters are compared; up to half the sampling rate, a filter of a lower rate
# follows what is aliased.
BELOW_WARPING = np.geomspace(1e-4, 0.4, 200)
# The error of a response relative to its size, or to this part of the largest, counts alike.
WEAK = 1e-2


def linear_candidates(
    response: FrequencyResponse, orders: tuple[int | None, int | None], total: int, oversampling: int
) -> Iterator[Filters]:
    """Pairs of filters that divide the poles and zeros of the best linear approximation.

    Args:
        response: measured, without the delay.
        orders: of the first and the second filter; None if the structure has no such filter.
        total: order of the approximation; its zeros are divided in any way that keeps the filters proper.
        oversampling: of the cascade.
    """
    b, a, _ = fit_rational(response, total + 1, total, oversampling)
    whole = Rational(b, a)
    first, second = orders
    if first is None or second is None:
        yield (whole, None) if second is None else (None, whole)
        return
    poles, zeros = _groups(whole.poles), _groups(whole.zeros)
    if first % 2 and second % 2 and all(len(group) == 2 for group in zeros):
        # Pairs of zeros cannot be divided between two odd orders; of one zero less, one at least is real.
        b, a, _ = fit_rational(response, total, total, oversampling)
        poles, zeros = _groups(Rational(b, a).poles), _groups(Rational(b, a).zeros)
    if not any(True for _ in _splits(poles, first)):
        poles = _parted(poles)
    yield from _divisions(poles, zeros, (first, second))


def _divisions(poles: list[list[complex]], zeros: list[list[complex]], orders: tuple[int, int]) -> Iterator[Filters]:
    """Pairs of proper filters of these orders that have these poles and zeros together, `MOST_SPLITS` at most."""
    first, second = orders

    def divided() -> Iterator[Filters]:
        for p1, p2 in _splits(poles, first):
            for share in product((0, 1), repeat=len(zeros)):
                z1 = [z for group, side in zip(zeros, share, strict=True) if side == 0 for z in group]
                z2 = [z for group, side in zip(zeros, share, strict=True) if side == 1 for z in group]
                if len(z1) <= first and len(z2) <= second:
                    yield _from_roots(z1, p1, first), _from_roots(z2, p2, second)

    return islice(divided(), MOST_SPLITS)


def divided_anew(cascade: Cascade) -> Iterator[Cascade]:
    """The cascade with the poles and zeros of its two filters divided between them in every way; their gains stay.

    Args:
        cascade: the model; with fewer filters there is nothing to divide.
    """
    filters = [(k, block) for k, block in enumerate(cascade.blocks) if isinstance(block, Rational)]
    if len(filters) < 2:
        return
    (k, first), (m, second) = filters
    poles = _groups(np.concatenate([first.poles, second.poles]))
    zeros = _groups(np.concatenate([first.zeros, second.zeros]))
    blocks = list(cascade.blocks)
    for one, other in _divisions(poles, zeros, (len(first.denominator), len(second.denominator))):
        assert one is not None
        assert other is not None
        blocks[k] = of_unit_gain(one).amplified(first.gain)
        blocks[m] = of_unit_gain(other).amplified(second.gain)
        yield replace(cascade, blocks=tuple(blocks))


def delay_exchanged(cascade: Cascade) -> Iterator[Cascade]:
    """The cascade with one sample of delay moved from its second filter to the first, and the other way round.

    A filter of the same order that responds as H(q)q^∓1 does at low frequencies takes the place of H. Both cascades
    have almost the same linear response, and poles and zeros that no division of those of the model gives.

    Args:
        cascade: the model; with fewer filters there is nothing to move.
    """
    at = [k for k, block in enumerate(cascade.blocks) if isinstance(block, Rational)]
    if len(at) < 2:
        return
    for moved in (1, -1):
        blocks = list(cascade.blocks)
        for k, samples in zip(at, (moved, -moved), strict=True):
            block = blocks[k]
            assert isinstance(block, Rational)
            blocks[k] = _alike(block, delay=samples)
        yield replace(cascade, blocks=tuple(blocks))


def grown(cascade: Cascade, orders: tuple[int | None, int | None]) -> Cascade:
    """The same model with filters of larger orders: poles are added, each with a zero that cancels it.

    Args:
        cascade: the model.
        orders: of its filters; with one that is not given the model is returned as it is.
    """
    wanted = [order for order in orders if order is not None]
    if len(wanted) != sum(isinstance(block, Rational) for block in cascade.blocks):
        return cascade
    given = iter(wanted)
    blocks: list[Block] = []
    for block in cascade.blocks:
        if isinstance(block, Rational):
            for k in range(1, next(given) - len(block.denominator) + 1):
                block = with_cancelled_pole(block, 0.5**k)
        blocks.append(block)
    return replace(cascade, blocks=tuple(blocks))


def at_higher_rate(cascade: Cascade, oversampling: int) -> Cascade:
    """The cascade with blocks that run at a higher rate, whose filters respond alike at low frequencies.

    Args:
        cascade: the model.
        oversampling: of the new one, a multiple of that of the model.
    """
    ratio = oversampling // cascade.oversampling
    blocks = (_alike(block, ratio) if isinstance(block, Rational) else block for block in cascade.blocks)
    return replace(cascade, blocks=tuple(blocks), oversampling=oversampling)


def _alike(block: Rational, ratio: int = 1, delay: int = 0) -> Rational:
    """A filter at a higher rate, or with samples of delay more, that responds like this one at low frequencies."""
    b, a = block.numerator, block.denominator
    value = Rational(b, a).response(BELOW_WARPING, 1.0) * np.exp(-2j * np.pi * BELOW_WARPING * delay)
    b, a, _ = fit_rational(FrequencyResponse(BELOW_WARPING, value), len(b), len(a), ratio)
    return Rational(b, a, block.delay * ratio)


def with_cancelled_pole(block: Rational, pole: float) -> Rational:
    """The same filter with one pole more, and a zero that cancels it."""
    both = np.array([1.0, -pole])
    denominator = np.convolve(np.concatenate([[1.0], block.denominator]), both)[1:]
    return Rational(np.convolve(block.numerator, both), denominator, block.delay)


def regression_candidate(records: Sequence[Record], order: int, degree: int, delay: int) -> tuple[Polynomial, Rational]:
    """The paper's least-squares solution (5.8) factorised into a map and a second filter.

    Args:
        records: one input, one output each.
        order: n_a of the second filter, whose numerator has one more coefficient.
        degree: of the polynomial.
        delay: nk in samples.

    Returns:
        The polynomial with λ₁b₁ as its slope at zero, and the filter D/A with d of unit length.
    """
    structure = wiener_hammerstein_regression(order, order + 1, degree, taps=1, nk=delay)
    theta = gather(structure, records)[0].solve().estimate
    powers = theta[order:].reshape(degree, order + 1)
    # s = λ ⊗ d; the regressors are ordered by power, then by delay.
    left, singular, right = np.linalg.svd(powers, full_matrices=False)
    low = min(float(record.input.min()) for record in records)
    high = max(float(record.input.max()) for record in records)
    curve = Polynomial.from_powers(np.concatenate([[0.0], left[:, 0] * singular[0]]), low, high)
    return curve, _stable(Rational(right[0], theta[:order]))


def sign_recovery_candidates(
    segments: Segments,
    orders: tuple[int | None, int | None],
    rng: np.random.Generator,
    control: Control = FREE,
) -> Iterator[tuple[Filters, float]]:
    """Filters before and after a sensor that loses the sign, and the input that gives zero output.

    The second filter is a fast one. The input is u₀ of the cascade, which matters for a map with a kink at zero.

    Args:
        segments: (u, y) of each; the longest is used.
        orders: of the first and the second filter; None if the structure has no such filter.
        rng: source of random numbers.
        control: when to stop.

    Raises:
        Stopped: if the search has to end; there is no model to keep yet.
    """
    first, second = orders
    if first is None:
        return
    u, y = max(segments, key=lambda pair: len(pair[0]))
    u, y = u[:TRIAL_SAMPLES], y[:TRIAL_SAMPLES]
    quick = None if second is None else _from_roots([], [complex(0.3 / (k + 1)) for k in range(second)], second)
    for found in recovered_signals(u, y, first, rng)[:MOST_SIGN_SEQUENCES]:
        level = found.constant / (1 + found.denominator.sum())
        start = Cascade((_stable(Rational(found.numerator, found.denominator)),), output_offset=level)
        record = Record(u, found.signal, 1.0)
        minimum, problem = search(
            start, record, max_iterations=30, tolerance=0.2, covariances=False, control=control.quietly()
        )
        control.check()
        for model in (start, problem.model(minimum.estimate)):
            (block,) = model.blocks
            assert isinstance(block, Rational)
            gain = block.resting(1.0)[1]
            yield (block, quick), 0.0
            if gain:
                yield (block, quick), -model.output_offset / gain


def _stable(block: Rational) -> Rational:
    """The filter with poles outside the unit circle mirrored into it."""
    poles = block.poles
    outside = np.abs(poles) >= 0.9999
    mirrored = np.where(outside, 0.9999 * poles / np.maximum(np.abs(poles), 1e-300) ** 2, poles)
    return replace(block, denominator=np.real(np.poly(mirrored))[1:]) if np.any(outside) else block


def _groups(roots: NDArray[np.complex128]) -> list[list[complex]]:
    """Real roots singly, complex ones in conjugate pairs."""
    real = [[complex(r.real)] for r in roots if abs(r.imag) <= 1e-9 * max(abs(r), 1e-300)]
    return real + [[complex(r), complex(np.conj(r))] for r in roots if r.imag > 1e-9 * abs(r)]


def _parted(groups: list[list[complex]]) -> list[list[complex]]:
    """Replace the complex pair nearest to the real axis by two real roots of the same size, so that it can be split."""
    pairs = sorted((group for group in groups if len(group) == 2), key=lambda group: abs(np.angle(group[0])))
    nearest = pairs[0]
    size = complex(abs(nearest[0]))
    return [group for group in groups if group is not nearest] + [[size], [size]]


def _splits(groups: list[list[complex]], first: int) -> Iterator[tuple[list[complex], list[complex]]]:
    """The ways of giving exactly ``first`` of the roots to the first filter."""
    if not groups:
        if first == 0:
            yield [], []
        return
    group, *others = groups
    if len(group) <= first:
        for left, right in _splits(others, first - len(group)):
            yield group + left, right
    if first <= sum(map(len, others)):
        for left, right in _splits(others, first):
            yield left, group + right


def _from_roots(zeros: list[complex], poles: list[complex], order: int) -> Rational:
    """The filter with these roots, numerator and denominator of this order."""
    numerator = np.atleast_1d(np.real(np.poly(zeros))) if zeros else np.ones(1)
    denominator = np.atleast_1d(np.real(np.poly(poles))) if poles else np.ones(1)
    return Rational(np.pad(numerator, (0, order + 1 - len(numerator))), denominator[1:])


def started(
    candidate: Cascade, start: Callable[[Array, Array], StaticMap], segments: Segments, which: int = 0
) -> Cascade:
    """The candidate with one map replaced by another, which starts from the curve of the old one.

    Args:
        candidate: the candidate.
        start: the new map from points x, z of the curve, up to a constant level.
        segments: (u, y) of each, which give the range of the data.
        which: the index of the map, by default the first.
    """
    at = [k for k, block in enumerate(candidate.blocks) if isinstance(block, StaticMap)][which]
    curve = candidate.blocks[at]
    assert isinstance(curve, StaticMap)
    x = np.concatenate([candidate.signals_from_rest(u)[at] for u, _ in segments])
    z = curve.value(x)
    new = start(x, z)
    level = float(np.mean(z - new.value(x)))
    for block in candidate.blocks[at + 1 :]:
        if isinstance(block, Rational):
            level = block.resting(level)[1]
    blocks = (*candidate.blocks[:at], new, *candidate.blocks[at + 1 :])
    return unit_gain(replace(candidate, blocks=blocks, output_offset=candidate.output_offset + level))
