"""What an analysis of models gives: curves over time and frequency, and maps of poles. They plot themselves.

Of several models in a list, an analysis gives `Several` results, which are drawn in one picture.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import wraps
from typing import Any, Concatenate, Generic, ParamSpec, Protocol, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from emsid.models.bands import Band
from emsid.presentation import Presented
from emsid.record.frames import frame

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
P = ParamSpec("P")
T = TypeVar("T", bound="Analysed", covariant=True)


class Analysed(Presented):
    """A result of an analysis, with the name of its model as ``of``."""

    of: str

    def columns(self) -> dict[str, NDArray[Any]]:
        """Its numbers as columns of equal lengths."""
        raise NotImplementedError

    def to_frame(self, library: str = "polars") -> Any:
        """A data frame with its numbers.

        Args:
            library: ``"polars"`` or ``"pandas"``.
        """
        return frame(self.columns(), library)

    def __repr__(self) -> str:
        points = len(next(iter(self.columns().values())))
        return f"{type(self).__name__}({self.of}, {points} points)"


class Several(tuple[T, ...], Presented, Generic[T]):
    """The results of several models, in the order of the models; drawn in one picture."""

    __slots__ = ()

    @property
    def labels(self) -> tuple[str, ...]:
        """The name of every model; a number follows where a name occurs again."""
        names = [each.of for each in self]
        return tuple(
            name if name not in names[:k] else f"{name}, no. {names[: k + 1].count(name)}"
            for k, name in enumerate(names)
        )

    def to_frame(self, library: str = "polars") -> Any:
        """A data frame with the rows of all results and the column ``model``.

        Args:
            library: ``"polars"`` or ``"pandas"``.
        """
        several = [each.columns() for each in self]
        names = list(dict.fromkeys(name for each in several for name in each))
        sizes = [len(next(iter(each.values()))) for each in several]

        def values(name: str) -> Iterator[NDArray[Any]]:
            return (each.get(name, np.full(size, np.nan)) for each, size in zip(several, sizes, strict=True))

        columns = {"model": np.repeat(self.labels, sizes)}
        return frame(columns | {name: np.concatenate(list(values(name))) for name in names}, library)

    def __repr__(self) -> str:
        return f"{type(self[0]).__name__ if self else 'Several'}s of {', '.join(self.labels)}"


class Analysis(Protocol[P, T]):
    """An analysis of a model, or of each in a list."""

    @overload
    def __call__(self, model: list[Any] | tuple[Any, ...], *args: P.args, **options: P.kwargs) -> Several[T]: ...
    @overload
    def __call__(self, model: Any, *args: P.args, **options: P.kwargs) -> T: ...


def of_each(analyse: Callable[Concatenate[Any, P], T]) -> Analysis[P, T]:
    """The analysis of a model, which of a list of models gives `Several` results."""

    @wraps(analyse)
    def one_or_several(model: Any, *args: P.args, **options: P.kwargs) -> Any:
        if isinstance(model, (list, tuple)):
            return Several(analyse(each, *args, **options) for each in model)
        return analyse(model, *args, **options)

    return one_or_several


@dataclass(frozen=True, eq=False, repr=False)
class TimeResponse(Band, Analysed):
    """A curve over time in s, with its confidence band.

    Attributes:
        of: the name of the model.
        quantity: what the curve is.
        outputs: name and unit of every output.
    """

    of: str = ""
    quantity: str = "TimeResponse"
    outputs: tuple[tuple[str, str], ...] = ()

    def columns(self) -> dict[str, NDArray[Any]]:
        """``t``, ``value``, ``low`` and ``high``; of several outputs, the last three with the name of the output."""
        found = {"t": self.x}
        for name, values in (("value", self.value), ("low", self.low), ("high", self.high)):
            each = values[:, None] if values.ndim == 1 else values
            one = each.shape[1] == 1
            found |= {
                name if one else f"{name} of {output}": y for (output, _), y in zip(self.outputs, each.T, strict=True)
            }
        return found

    to_frame = Analysed.to_frame
    __repr__ = Analysed.__repr__


@dataclass(frozen=True, eq=False, repr=False)
class BodeCurve(Analysed):
    """Magnitude and phase of a model or of a measured frequency response, with bands.

    Attributes:
        magnitude: in dB over Hz.
        phase: in degrees over Hz.
        of: the name of the model, or of the record.
        coherence: (m,) of what was measured: the share of the output's power that is linear in the inputs; else None.
        levels: (m,) by name, in dB like the magnitude: what noise and distortion add to a measured response.
    """

    magnitude: Band
    phase: Band
    of: str = ""
    coherence: Array | None = None
    levels: Mapping[str, Array] = field(default_factory=dict)

    def columns(self) -> dict[str, NDArray[Any]]:
        """``frequency``, ``magnitude`` and ``phase``, each of these with its ends, and the coherence of a record."""
        found = {"frequency": self.magnitude.x}
        for name, band in (("magnitude", self.magnitude), ("phase", self.phase)):
            found |= {name: band.value, f"{name}_low": band.low, f"{name}_high": band.high}
        return found if self.coherence is None else found | {"coherence": self.coherence}


@dataclass(frozen=True, eq=False, repr=False)
class PoleMap(Analysed):
    """Poles and zeros of the linear part of a model.

    Attributes:
        poles: (n,) in z, or in 1/s in continuous time.
        zeros: (m,) likewise.
        standard_error: (n,) of the real part, and of the imaginary part as its imaginary part; NaN where not known.
        dt: sample time in s; None in continuous time.
        of: the name of the model.
    """

    poles: Complex
    zeros: Complex
    standard_error: Complex
    dt: float | None
    of: str = ""

    def columns(self) -> dict[str, NDArray[Any]]:
        """``kind`` (pole or zero), ``real``, ``imaginary`` and the standard error of both."""
        both = np.concatenate([self.poles, self.zeros])
        error = np.concatenate([self.standard_error, np.full(len(self.zeros), complex(np.nan, np.nan))])
        return {
            "kind": np.repeat(["pole", "zero"], [len(self.poles), len(self.zeros)]),
            "real": both.real,
            "imaginary": both.imag,
            "error_real": error.real,
            "error_imaginary": error.imag,
        }


@dataclass(frozen=True, eq=False, repr=False)
class ModeTable(Analysed):
    """Oscillating modes of the linear part of a model: resonances, and antiresonances where it is square.

    Attributes:
        kind: (k,) ``resonance`` or ``antiresonance``, ascending in frequency.
        frequency: (k,) in Hz, |s|/2π: what it is without damping.
        damping: (k,) ratio −Re(s)/|s|; negative where it grows.
        frequency_error, damping_error: (k,) standard errors; NaN where not known.
        level: of the intervals of `columns`.
        of: the name of the model.
    """

    kind: tuple[str, ...]
    frequency: Array
    damping: Array
    frequency_error: Array
    damping_error: Array
    level: float = 0.95
    of: str = ""

    def __len__(self) -> int:
        return len(self.kind)

    def columns(self) -> dict[str, NDArray[Any]]:
        """``kind``, ``frequency`` and ``damping`` with the ends of their intervals."""
        found: dict[str, NDArray[Any]] = {"kind": np.array(self.kind, dtype=str)}
        for name in ("frequency", "damping"):
            band = Band(np.zeros(len(self)), getattr(self, name), getattr(self, f"{name}_error"), self.level)
            found |= {name: band.value, f"{name}_low": band.low, f"{name}_high": band.high}
        return found

    def __str__(self) -> str:
        def line(kind: str, f: float, f_error: float, ratio: float, ratio_error: float) -> str:
            half = [f" ± {1.96 * error:.2g}" if np.isfinite(error) else "" for error in (f_error, ratio_error)]
            return (
                f"{kind:14} {f:.6g}{half[0]} Hz, damping {100 * ratio:.4g}{half[1] and f' ± {196 * ratio_error:.2g}'} %"
            )

        rows = zip(self.kind, self.frequency, self.frequency_error, self.damping, self.damping_error, strict=True)
        return "\n".join(line(*row) for row in rows) or "no oscillating modes"
