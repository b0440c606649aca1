"""A static map defined by the user."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import EmsidError, ModelError
from emsid.models.blocks.static_maps.static_map import Scaling, StaticMap
from emsid.models.terms import vector

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class UserMap(StaticMap):
    """A static map defined by the user, y = f(x, θ), with its derivatives.

    Its scale is fixed: no factor is moved through it. Where it has no value (NaN), a search can neither start nor go.

    Args:
        function: f(x (N,), θ (p,)) → (N,).
        derivative: ∂f/∂x of the same arguments → (N,).
        jacobian: ∂f/∂θ of the same arguments → (p, N); not needed without parameters.
        parameters_now: (p,) θ.
        parameter_names: (p,) a name for every parameter.

    Raises:
        ModelError: for different numbers of names and parameters; when called, for results of a wrong shape and for
            functions that fail.
    """

    function: Callable[[Array, Array], Array]
    derivative: Callable[[Array, Array], Array]
    jacobian: Callable[[Array, Array], Array] | None = None
    parameters_now: Array = ()  # type: ignore[assignment]  # made an array below
    parameter_names: tuple[str, ...] = ()

    kind: ClassVar[str] = "user"
    scaling: ClassVar[Scaling] = Scaling.NONE
    absorbs_shift: ClassVar[bool] = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters_now", vector(self.parameters_now, "user map parameters"))
        names = self.parameter_names or tuple(f"p{k + 1}" for k in range(len(self.parameters_now)))
        object.__setattr__(self, "parameter_names", names)
        if len(names) != len(self.parameters_now):
            raise ModelError(f"user map: {len(names)} names for {len(self.parameters_now)} parameters")
        if len(names) and self.jacobian is None:
            raise ModelError("user map: a map with parameters needs its derivative with respect to them")

    @property
    def names(self) -> tuple[str, ...]:
        """The given names."""
        return self.parameter_names

    @property
    def parameters(self) -> Array:
        """(p,) θ."""
        return self.parameters_now

    @property
    def anchors(self) -> tuple[int, ...]:
        """None."""
        return ()

    @property
    def steepness(self) -> float:
        """One, because no factor is moved through it."""
        return 1.0

    def with_parameters(self, theta: Array) -> UserMap:
        """The map with other parameters."""
        return replace(self, parameters_now=theta)

    def value(self, x: Array) -> Array:
        """f(x, θ)."""
        return self._called(self.function, x, x.shape, "function")

    def slope(self, x: Array) -> Array:
        """∂f/∂x."""
        return self._called(self.derivative, x, x.shape, "derivative")

    def parameter_gradient(self, x: Array) -> Array:
        """∂f/∂θ."""
        if self.jacobian is None:
            return np.zeros((0, len(x)))
        return self._called(self.jacobian, x, (len(self.parameters_now), len(x)), "jacobian")

    def inverse(self, z: ArrayLike) -> Array:
        """Not known.

        Raises:
            ModelError: always.
        """
        raise ModelError("the inverse of a user's own map is not known")

    def scaled(self, input: float, output: float) -> UserMap:
        """The map itself, for factors of one."""
        if not (np.isclose(input, 1) and np.isclose(output, 1)):
            raise ModelError("no factor can be moved through a user's own map")
        return self

    def expression(self, x: str) -> str:
        """The function's name with its parameters."""
        values = (f"{n}={v:.6g}" for n, v in zip(self.names, self.parameters_now, strict=True))
        name = getattr(self.function, "__name__", "f")
        return f"{name if name.isidentifier() else 'f'}({', '.join([x, *values])})"

    def to_data(self) -> dict[str, Any]:
        """Not possible.

        Raises:
            ModelError: always; a function cannot be kept in a file.
        """
        raise ModelError("a user's own map is a function and cannot be saved; save its parameters instead")

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> UserMap:
        """Not possible, as `to_data`.

        Raises:
            ModelError: always.
        """
        raise ModelError("a user's own map is a function and is in no file; build it from its functions")

    def _called(self, law: Callable[[Array, Array], Array], x: Array, shape: tuple[int, ...], what: str) -> Array:
        """The result of the user's function, checked. The function gets read-only views."""
        shown = x.view(), self.parameters_now.view()
        for each in shown:
            each.flags.writeable = False
        try:
            array = np.asarray(law(*shown), dtype=float)
        except EmsidError:
            raise
        except Exception as problem:  # whatever a user's code may raise
            raise ModelError(f"the {what} of a user's map failed: {type(problem).__name__}: {problem}") from problem
        if array.shape != shape:
            raise ModelError(f"the {what} of a user's map returned shape {array.shape} instead of {shape}")
        return array
