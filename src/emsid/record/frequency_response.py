"""`FrequencyResponse`: a measured frequency response as data, estimated from records or read from a table."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError
from emsid.presentation import Presented
from emsid.record.frames import frame
from emsid.units import conversion, si_unit

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

WEAK = 1e-3
"""Where nothing is known of the errors, those of smaller values count relative to this part of the largest."""


@dataclass(frozen=True, eq=False, repr=False)
class FrequencyResponse(Presented):
    """A frequency response with its uncertainty. Its arrays are read-only.

    A variance is that of the complex response, E|Ĝ − G|², which real and imaginary part share equally.

    Args:
        frequency: (F,) in Hz, ascending.
        response: (F, ny, nu) output over input; (F,) of one input and one output.
        total: (F, ny, nu) variance by noise and nonlinear distortion; None where it is not known.
        noise: (F, ny, nu) the part of it by noise; None where the two were not told apart, or distortion not seen.
        even: (F, ny, nu) variance by even distortion, which the fast method sees at lines without input; else None.
        coherence: (F, ny) share of the power of each output that is linear in the inputs; None where not known.
        dt: sample time in s of inputs that are held between samples; None of a response in continuous time.
        input_names, output_names: a name for every channel; ``u1, u2, …`` and ``y1, y2, …`` by default.
        input_units, output_units: a unit for every channel; empty if unknown.
        realisations: how many different excitations were averaged.
        overlap: how many neighbouring frequencies share the same data: a fit multiplies the covariance with it.
        method: how it was estimated.
        name: of the source.

    Raises:
        DataError: for shapes that do not agree, frequencies that do not ascend, or numbers that are not finite.
    """

    frequency: Array
    response: Complex
    total: Array | None = None
    noise: Array | None = None
    even: Array | None = None
    coherence: Array | None = None
    dt: float | None = None
    input_names: tuple[str, ...] = ()
    output_names: tuple[str, ...] = ()
    input_units: tuple[str, ...] = ()
    output_units: tuple[str, ...] = ()
    realisations: int = 1
    overlap: float = 1.0
    method: str = "table"
    name: str = "response"

    def __post_init__(self) -> None:
        f = np.atleast_1d(np.asarray(self.frequency, dtype=float))
        g = np.asarray(self.response, dtype=complex)
        g = g.reshape(len(g), 1, 1) if g.ndim == 1 else g
        if f.ndim != 1 or g.ndim != 3 or len(g) != len(f) or not len(f):
            raise DataError(f"{self.name}: a response of shape {g.shape} at {f.size} frequencies; give (F, ny, nu)")
        if not (np.isfinite(f).all() and np.isfinite(g).all() and f[0] >= 0 and np.all(np.diff(f) > 0)):
            raise DataError(f"{self.name}: frequencies must ascend from 0 Hz or above, and all numbers be finite")
        arrays: dict[str, NDArray[Any] | None] = {"frequency": f, "response": g}
        for field in ("total", "noise", "even", "coherence"):
            values, wanted = getattr(self, field), g.shape[:2] if field == "coherence" else g.shape
            if values is not None:
                values = np.asarray(values, dtype=float)
                if values.size != np.prod(wanted):
                    raise DataError(f"{self.name}: {field} of shape {values.shape}; give {wanted}")
                values = values.reshape(wanted)
            arrays[field] = values
        for field, values in arrays.items():
            if values is not None:
                values = values.view()
                values.flags.writeable = False
            object.__setattr__(self, field, values)
        for side, letter, width in (("input", "u", g.shape[2]), ("output", "y", g.shape[1])):
            names = tuple(getattr(self, f"{side}_names")) or tuple(f"{letter}{k + 1}" for k in range(width))
            units = tuple(getattr(self, f"{side}_units")) or ("",) * width
            if len(names) != width or len(units) != width:
                raise DataError(f"{self.name}: {len(names)} names and {len(units)} units for {width} {side}s")
            object.__setattr__(self, f"{side}_names", names)
            object.__setattr__(self, f"{side}_units", units)

    def __len__(self) -> int:
        return len(self.frequency)

    def __repr__(self) -> str:
        pairs = f"{', '.join(self.input_names)} to {', '.join(self.output_names)}"
        band = f"{self.frequency[0]:.4g} to {self.frequency[-1]:.4g} Hz"
        return f"FrequencyResponse({self.name}: {len(self)} frequencies, {band}; {pairs}; {self.method})"

    @property
    def of(self) -> str:
        """Its name, as of every result of an analysis."""
        return self.name

    @property
    def magnitude(self) -> Array:
        """(F, ny, nu) in dB."""
        return np.asarray(20 * np.log10(np.abs(self.response)))

    @property
    def phase(self) -> Array:
        """(F, ny, nu) in degrees, continuous over frequency."""
        return np.asarray(np.degrees(np.unwrap(np.angle(self.response), axis=0)))

    @property
    def distortion(self) -> Array | None:
        """(F, ny, nu) variance by nonlinear distortion in one realisation; None where not separated from noise."""
        if self.noise is None or self.total is None:
            return None
        return self.realisations * np.maximum(self.total - self.noise, 0.0)

    @property
    def total_or_relative(self) -> Array:
        """(F, ny, nu) its variance; where it is not known, the square of its size, so that relative errors count."""
        if self.total is not None:
            return self.total
        size = np.abs(self.response)
        return np.asarray(np.maximum(size, WEAK * size.max(axis=0)) ** 2)

    def ahead(self, time: float) -> FrequencyResponse:
        """The response without a dead time in s; itself without any."""
        turned = np.exp(2j * np.pi * self.frequency * time)[:, None, None]
        return replace(self, response=self.response * turned) if time else self

    def between(self, lowest: float = 0.0, highest: float = np.inf) -> FrequencyResponse:
        """The part of it in a band.

        Args:
            lowest, highest: ends of the band in Hz, included.

        Raises:
            DataError: for a band without a frequency.
        """
        return self._at(np.flatnonzero((self.frequency >= lowest) & (self.frequency <= highest)))

    def _at(self, rows: NDArray[np.intp]) -> FrequencyResponse:
        if not len(rows):
            raise DataError(f"{self.name} has no frequency in this band; it covers {self!r}")
        chosen: dict[str, Any] = {field: values[rows] for field, values in self._arrays()}
        return replace(self, **chosen)

    def path(self, output: int = 0, input: int = 0) -> FrequencyResponse:
        """The response of one output to one input.

        Args:
            output, input: from 0.

        Raises:
            DataError: for a channel that it does not have.
        """
        outputs, inputs = self.response.shape[1:]
        if not (0 <= output < outputs and 0 <= input < inputs):
            raise DataError(f"{self.name} has {inputs} inputs and {outputs} outputs; give their numbers from 0")
        one: dict[str, Any] = {
            field: values[:, [output]] if field == "coherence" else values[:, [output]][:, :, [input]]
            for field, values in self._arrays()
            if field != "frequency"
        }
        for side, k in (("input", input), ("output", output)):
            one |= {f"{side}_{what}": (getattr(self, f"{side}_{what}")[k],) for what in ("names", "units")}
        return replace(self, **one)

    def _arrays(self) -> Iterator[tuple[str, NDArray[Any]]]:
        for field in ("frequency", "response", "total", "noise", "even", "coherence"):
            if (values := getattr(self, field)) is not None:
                yield field, values

    def in_si(self) -> FrequencyResponse:
        """The response in SI, as far as the units of its channels can be converted."""
        factors: dict[str, Array] = {}
        units: dict[str, Any] = {}
        for side in ("input", "output"):
            own = getattr(self, f"{side}_units")
            targets = [si_unit(unit) if unit else "" for unit in own]
            pairs = list(zip(own, targets, strict=True))
            factors[side] = np.array([conversion(unit, target)[0] if target else 1.0 for unit, target in pairs])
            units[f"{side}_units"] = tuple(target or unit for unit, target in pairs)
        scale = factors["output"][:, None] / factors["input"]
        arrays = dict(self._arrays())
        scaled: dict[str, Any] = {
            field: arrays[field] * (scale if field == "response" else scale**2)
            for field in ("response", "total", "noise", "even")
            if field in arrays
        }
        return replace(self, **units, **scaled)

    def columns(self) -> dict[str, Array]:
        """Frequency in Hz, magnitude in dB, phase in degrees, and what else is known, numbered by output and input.

        ``deviation``, ``noise``, ``distortion`` and ``even`` are standard deviations of the response in dB, to be
        compared with its magnitude.
        """
        outputs, inputs = self.response.shape[1:]
        found = {"frequency": np.asarray(self.frequency)}
        variances = {"deviation": self.total, "noise": self.noise, "distortion": self.distortion, "even": self.even}
        for i in range(outputs):
            for j in range(inputs):
                end = "" if outputs * inputs == 1 else f"_{i + 1}_{j + 1}"
                found |= {f"magnitude{end}": self.magnitude[:, i, j], f"phase{end}": self.phase[:, i, j]}
                for field, values in variances.items():
                    if values is not None:
                        with np.errstate(divide="ignore"):
                            found[f"{field}{end}"] = 10 * np.log10(values[:, i, j])
            if self.coherence is not None:
                found["coherence" if outputs == 1 else f"coherence_{i + 1}"] = self.coherence[:, i]
        return found

    def to_frame(self, library: str = "polars") -> Any:
        """A data frame with its `columns`.

        Args:
            library: ``"polars"`` or ``"pandas"``.
        """
        return frame(self.columns(), library)
