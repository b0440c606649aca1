"""A static map defined by the user."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import EmsidError, ModelError
from emsid.models.blocks.static_maps.static_map import Scaling, StaticMap
from emsid.models.terms import vector

Array = NDArray[np.float64]

# A map is checked at this many inputs. Their number is prime, so that no period of a map is missed.
CHECKED = 101
# Derivatives are wrong if more than this part of those that are compared differ from differences of the function by
# more than the second number. At a kink or a jump a few differ.
WRONG, APART = 0.2, 0.05
# The step of a difference, relative to the range of inputs or to a parameter.
STEP = 1e-6


@dataclass(frozen=True, eq=False)
class UserMap(StaticMap):
    """A static map defined by the user, y = f(x, θ), with its derivatives.

    Its scale is fixed: no factor is moved through it. Where it has no value (NaN), a search can neither start nor go.
    The functions are called once when the map is made, at typical inputs, and their derivatives compared with
    differences.

    Args:
        function: f(x (N,), θ (p,)) → (N,).
        derivative: ∂f/∂x of the same arguments → (N,).
        jacobian: ∂f/∂θ of the same arguments → (p, N); not needed without parameters.
        parameters_now: (p,) θ.
        parameter_names: (p,) a name for every parameter.
        inputs: the range of typical inputs, at which the functions are checked.

    Raises:
        ModelError: for different numbers of names and parameters, functions that fail, results of a wrong shape or that
            are not real or nowhere finite, and wrong derivatives.
    """

    function: Callable[[Array, Array], Array]
    derivative: Callable[[Array, Array], Array]
    jacobian: Callable[[Array, Array], Array] | None = None
    parameters_now: Array = ()  # type: ignore[assignment]  # made an array below
    parameter_names: tuple[str, ...] = ()
    inputs: tuple[float, float] = (-3.0, 3.0)

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
        if len(self.inputs) != 2 or not self.inputs[0] < self.inputs[1] or not np.isfinite(self.inputs).all():
            raise ModelError(f"user map: inputs {self.inputs}; give the smallest and the largest typical input")
        self._check()

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
        """The map with other parameters; its functions are not checked again."""
        made = copy(self)
        object.__setattr__(made, "parameters_now", vector(theta, "user map parameters"))
        if len(made.parameters_now) != len(self.parameters_now):
            raise ModelError(f"user map: {len(self.names)} names for {len(made.parameters_now)} parameters")
        return made

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
        views = x.view(), self.parameters_now.view()
        for each in views:
            each.flags.writeable = False
        try:
            with np.errstate(all="ignore"):  # outside its domain a function returns NaN
                array = np.asarray(law(*views))
        except EmsidError:
            raise
        except Exception as problem:  # whatever a user's code may raise
            raise ModelError(f"the {what} of a user's map failed: {type(problem).__name__}: {problem}") from problem
        if array.dtype.kind not in "fiub":
            raise ModelError(f"the {what} of a user's map returned {array.dtype} numbers; it must return real ones")
        if array.shape != shape:
            raise ModelError(f"the {what} of a user's map returned shape {array.shape} instead of {shape}")
        return array.astype(float, copy=False)

    def _check(self) -> None:
        """Call every function once, and compare the derivatives with differences.

        Raises:
            ModelError: for what is wrong with them.
        """
        low, high = self.inputs
        x = np.linspace(low, high, CHECKED)
        between = f"inputs from {low:g} to {high:g}"
        value, slope = self.value(x), self.slope(x)
        if not np.isfinite(value).any():
            raise ModelError(
                f"the function of a user's map is not finite at {between}; correct it, or give the typical inputs where"
                " it has values, such as inputs=(0, 1)"
            )
        step = STEP * (high - low)
        difference = (self.value(x + step) - self.value(x - step)) / (2 * step)
        self._compare("derivative", slope, difference, value, step, between)
        rows = self.parameter_gradient(x)
        for k, (name, number) in enumerate(zip(self.names, self.parameters_now, strict=True)):
            step = STEP * (abs(number) or 1.0)
            moved = step * np.eye(1, len(self.names), k)[0]
            ahead, behind = (self.with_parameters(self.parameters_now + sign * moved).value(x) for sign in (1, -1))
            what = f"jacobian (row {k}, the derivative by {name})"
            self._compare(what, rows[k], (ahead - behind) / (2 * step), value, step, between)

    @staticmethod
    def _compare(what: str, given: Array, difference: Array, value: Array, step: float, between: str) -> None:
        """Refuse a derivative (N,) that is not that of the function.

        Args:
            what: its name.
            given: the derivative.
            difference: quotients of the function's values.
            value: of the function.
            step: of the differences.
            between: the inputs in words.
        """
        known = np.isfinite(difference) & np.isfinite(value)
        if not known.any():
            return
        given, difference, value = given[known], difference[known], value[known]
        rounding = 100 * np.finfo(float).eps * np.abs(value) / step
        apart = np.abs(given - difference) > APART * np.maximum(np.abs(given), np.abs(difference)) + rounding
        wrong = apart | ~np.isfinite(given)
        if np.mean(wrong) > WRONG:
            k = int(np.flatnonzero(wrong)[0])
            raise ModelError(
                f"the {what} of a user's map is wrong at {np.count_nonzero(wrong)} of {len(wrong)} {between}; it is "
                f"{given[k]:.4g} where differences of the function give {difference[k]:.4g}"
            )
