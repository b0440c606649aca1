r"""A linear system as a sum of its modes: real blocks of two states, or of one.

    xₖ(t + 1) = Aₖ xₖ(t) + Bₖ v(t)        Aₖ = (σ g; h σ)        y = Σ Cₖ xₖ + D v + y₀

The poles of a block are σ ± √(gh). As g is a number of the form and not zero, a block becomes two real poles or a pair
of complex ones without a break, and with g = |h| it is a rotation that shrinks: twenty lightly damped modes are as well
conditioned as one. The entry b = (b₁, b₂) gives the same as Nb/g and e₂ do, since N = Aₖ − σ commutes with Aₖ: all
states, and all derivatives of outputs, are combinations of the responses of every block to the entry e₂ = (0, 1).

Changes of basis that keep Aₖ are αI + βN. They are excluded by an entry of every block that is not varied.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.estimation.compiled import read_only

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FLATTEST = 1e-2
"""The least g, as a part of the larger singular value of N: where two real poles meet, it is not zero."""
WORST, PERTURBED = 1e8, 1e-9
"""The condition of a modal basis beyond which A is changed by this part, and by ten times as much where that is not
enough: more than two poles at one place have no such basis, and close to them there is one."""


@dataclass(frozen=True, eq=False)
class Modal:
    """A system in modal form.

    Args:
        centre, lower, upper: (m,) σ, h and g of the blocks.
        single: (m,) which blocks have one state, the second, with the pole σ.
        b: (m, 2, nv).
        c: (ny, m, 2).
        d: (ny, nv).
        level: (ny,) y₀.
    """

    centre: Array
    lower: Array
    upper: Array
    single: Mask
    b: Array
    c: Array
    d: Array
    level: Array

    @classmethod
    def of(cls, a: Array, b: Array, c: Array, d: Array, level: Array, *, apart: bool = False) -> Modal:
        """That of a system in any basis, or of one close to it; every real pole has a block of its own if ``apart``."""
        basis, centre, lower, upper, single = modal_basis(a, apart)
        m, kept = len(centre), ~np.stack([single, np.zeros_like(single)], axis=1).ravel()
        entry, row = np.zeros((2 * m, b.shape[1])), np.zeros((len(c), 2 * m))
        entry[kept], row[:, kept] = np.linalg.solve(basis, b), c @ basis
        return cls(
            centre,
            lower,
            upper,
            single,
            entry.reshape(m, 2, b.shape[1]),
            row.reshape(len(c), m, 2),
            d.astype(float),
            level,
        )

    @property
    def varied(self) -> tuple[Array, ...]:
        """The numbers of the form that a search varies."""
        return self.centre, self.lower, self.b, self.c, self.d, self.level

    def with_varied(self, parts: list[Array]) -> Modal:
        """The same form with other numbers, in the order of `varied`."""
        centre, lower, b, c, d, level = parts
        return replace(self, centre=centre, lower=lower, b=b, c=c, d=d, level=level)

    @property
    def fixed(self) -> tuple[Mask, ...]:
        """Which of `varied` a search does not vary: one entry of every block, and what a block of one state lacks.

        The entry is that of the input which reaches both states best.
        """
        b, alone = np.zeros(self.b.shape, dtype=bool), self.single[:, None]
        reached = np.abs(self.lower[:, None] * self.b[:, 0] ** 2 - self.upper[:, None] * self.b[:, 1] ** 2)
        b[np.arange(len(b)), :, np.argmax(reached, axis=1)] = True
        b[:, 0] |= alone
        c = np.zeros(self.c.shape, dtype=bool)
        c[:, self.single, 0] = True
        rest = [np.zeros(each.shape, dtype=bool) for each in (self.centre, self.d, self.level)]
        return rest[0], self.single, b, c, rest[1], rest[2]

    @property
    def radius(self) -> float:
        """The largest size of a pole."""
        square = self.lower * self.upper
        size = np.where(
            square < 0, np.sqrt(np.abs(self.centre**2 - square)), np.abs(self.centre) + np.sqrt(np.abs(square))
        )
        return float(size.max())

    def matrices(self) -> tuple[Array, Array, Array]:
        """A (n, n) with its blocks on the diagonal, B (n, nv) and C (ny, n)."""
        m = len(self.centre)
        a = np.zeros((m, 2, m, 2))
        for k in range(m):
            a[k, :, k] = [[self.centre[k], self.upper[k]], [self.lower[k], self.centre[k]]]
        kept = ~np.stack([self.single, np.zeros_like(self.single)], axis=1).ravel()
        whole = a.reshape(2 * m, 2 * m)[np.ix_(kept, kept)]
        return whole, self.b.reshape(2 * m, self.b.shape[2])[kept], self.c.reshape(len(self.c), 2 * m)[:, kept]

    def _responses(self, signals: Array, begin: Array) -> Array:
        """(m, s, 2, N) of every block to signals (m, s, N) through the entry e₂, from the states ``begin`` (s, 2)."""
        found = np.empty((*signals.shape[:2], 2, signals.shape[2]))
        block_responses(found, *map(read_only, (self.centre, self.lower, self.upper, signals, begin)))
        return found

    def signals(self, v: Array) -> Array:
        """(m, nv + 1, 2, N) the responses of every block through e₂ to the inputs v (nv, N), and last from e₂ alone."""
        inputs, samples = v.shape
        driving = np.broadcast_to(np.vstack([v, np.zeros(samples)]), (len(self.centre), inputs + 1, samples))
        return self._responses(driving, np.array([[0.0, 0.0]] * inputs + [[0.0, 1.0]]))

    def driven(self, states: Array) -> Array:
        """(m, 2, 2, N) the responses of every block through e₂ to its own two states (m, 2, N)."""
        return self._responses(states, np.zeros((2, 2)))

    def through_first(self, responses: Array) -> Array:
        """Responses (m, …, 2, N) through e₂ as those through (1, 0): Nr/g."""
        ratio = (self.lower / self.upper).reshape(-1, *(1,) * (responses.ndim - 2))
        return np.stack([responses[..., 1, :], ratio * responses[..., 0, :]], axis=-2)

    def states(self, signals: Array, first: Array) -> Array:
        """(m, 2, N) the states, from `signals` and the initial states (m, 2)."""
        entries = np.concatenate([self.b, first[:, :, None]], axis=2)
        m, s, _, samples = signals.shape
        flat = [each.reshape(m, s, 2 * samples) for each in (self.through_first(signals), signals)]
        found = entries[:, :1] @ flat[0] + entries[:, 1:] @ flat[1]
        return np.asarray(found.reshape(m, 2, samples))

    def derivatives(
        self, weights: Array, first: Array, signals: Array, driven: Array, v: Array
    ) -> tuple[tuple[Array, ...], Array]:
        """Of ``weights`` · y by `varied`, each with N last, and by the initial states (m, 2, N).

        Args:
            weights: (ny,) of the outputs.
            first: (m, 2) the initial states.
            signals, driven: of the methods of these names.
            v: (nv + 1, N) the inputs, and last a one in every sample.
        """
        c = np.tensordot(weights, self.c, 1)[:, None]  # (m, 1, 2)

        def seen(responses: Array) -> Array:
            m, s, _, samples = responses.shape
            return np.asarray((c[:, None] @ responses).reshape(m, s, samples))

        from_first, from_second = seen(self.through_first(signals)), seen(signals)
        both = np.stack([from_first, from_second], axis=1)  # (m, 2, nv + 1, N)
        by_lower = seen(driven[:, :1])[:, 0]
        by_centre = seen((self.through_first(driven[:, 0]) + driven[:, 1])[:, None])[:, 0]
        by_c = np.multiply.outer(weights, self.states(signals, first))
        by_d = np.multiply.outer(weights, v)
        return (by_centre, by_lower, both[:, :, :-1], by_c, by_d[:, :-1], by_d[:, -1]), both[:, :, -1]


def modal_basis(a: Array, apart: bool) -> tuple[Array, Array, Array, Array, Mask]:
    """The basis (n, n) in which A has the blocks of `Modal`, their σ, h and g, and which of them have one state."""
    rng, size = np.random.default_rng(0), 0.0
    while True:
        found = _modal_basis(a + size * max(float(np.abs(a).max()), 1.0) * rng.standard_normal(a.shape), apart)
        size = max(10 * size, PERTURBED)
        if size > 1 or np.linalg.cond(found[0]) < WORST:
            return found


def _modal_basis(a: Array, apart: bool) -> tuple[Array, Array, Array, Array, Mask]:
    """As `modal_basis`, of a matrix without more than two poles at one place."""
    values = np.linalg.eigvals(a).astype(complex)
    complex_ones, real = values[values.imag > 0], np.sort(values[values.imag == 0].real)[::-1]
    pairs = [(z.real, -(z.imag**2)) for z in sorted(complex_ones, key=lambda z: abs(float(np.angle(z))))]
    paired = 0 if apart else len(real) // 2
    pairs += [((p + q) / 2, ((p - q) / 2) ** 2) for p, q in real[: 2 * paired].reshape(paired, 2)]
    columns, blocks, identity = [], [], np.eye(len(a))
    for centre, square in pairs:
        off = a - centre * identity
        plane = np.linalg.svd(off @ off - square * identity)[2][-2:].T
        small = plane.T @ off @ plane
        centre += np.trace(small) / 2
        small -= np.trace(small) / 2 * np.eye(2)
        square = -float(np.linalg.det(small))
        _, sizes, right = np.linalg.svd(small)
        upper = max(sqrt(abs(square)), FLATTEST * sizes[0], 1e-300)
        columns += [plane @ small @ right[0] / upper, plane @ right[0]]
        blocks.append((centre, square / upper, upper, False))
    for pole in real[2 * paired :]:
        columns.append(np.linalg.svd(a - pole * identity)[2][-1])
        blocks.append((pole, 0.0, 1.0, True))
    centre_, lower, upper_, single = (np.array(each) for each in zip(*blocks, strict=True))
    return np.column_stack(columns), centre_, lower, upper_, single.astype(bool)


@njit(nogil=True)
def block_responses(found: Array, centre: Array, lower: Array, upper: Array, signals: Array, begin: Array) -> None:
    """Write into ``found`` (m, s, 2, N) what `Modal` calls the responses of its blocks."""
    for k in range(len(signals)):
        middle, down, up = centre[k], lower[k], upper[k]
        for j in range(signals.shape[1]):
            one, two = begin[j, 0], begin[j, 1]
            for t in range(signals.shape[2]):
                found[k, j, 0, t] = one
                found[k, j, 1, t] = two
                one, two = middle * one + up * two, down * one + middle * two + signals[k, j, t]
