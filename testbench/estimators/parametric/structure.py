"""ModelStructure: the equations and parameters that output error, filter error and the Kalman filters fit.

    dx/dt = f(x, u, params),    y = h(x, u, params)

Structures write f and h (a linear one: its matrices) in numpy operations that hold for complex numbers and for any
leading axes. Derivatives then come out exact to rounding by the complex step, df/dz = Im f(z + i h) / h with h = 1e-30
(Squire and Trapp, SIAM Review 40, 1998), for all directions at once.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.channels import channel
from testbench.core.errors import EstimationError, nearest
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.structured import STRUCTURE_NAMES

STEP = 1e-30
"""Complex step: far below rounding, so that the derivative has no truncation error, and nothing is subtracted."""

AnyArray = NDArray[Any]
_AFFINE = 1e-13  # of an entry's size: rounding


@dataclass(frozen=True)
class Parameter:
    """One parameter of a structure.

    Args:
        name: its symbol, e.g. ``Cm_alpha`` or ``M_q``.
        value: where estimation starts, or the value itself if it is not free; SI units.
        free: estimated, or held at ``value``.
        low, high: bounds that the estimate must keep.
        prior_std: standard deviation of the prior about ``value``; None: no prior.

    Raises:
        EstimationError: ``low <= value <= high`` or ``prior_std > 0`` does not hold.
    """

    name: str
    value: float
    free: bool = True
    low: float = -np.inf
    high: float = np.inf
    prior_std: float | None = None

    def __post_init__(self) -> None:
        if not self.low <= self.value <= self.high or not np.isfinite(self.value):
            raise EstimationError(
                f"low <= value <= high must hold for parameter '{self.name}', got value {self.value:g} and bounds "
                f"{self.low:g} to {self.high:g}"
            )
        if self.prior_std is not None and not self.prior_std > 0.0:
            raise EstimationError(f"prior_std > 0 must hold for parameter '{self.name}', got {self.prior_std:g}")


class Jacobians(NamedTuple):
    """Derivatives of f and h by state, input and parameters; each of shape (rows, columns)."""

    fx: FloatArray
    fu: FloatArray
    fp: FloatArray
    hx: FloatArray
    hu: FloatArray
    hp: FloatArray


class Matrices(NamedTuple):
    """dx/dt = A x + B u + bx, y = C x + D u + by, with the leading axes of the parameters that they were made from."""

    A: AnyArray
    B: AnyArray
    C: AnyArray
    D: AnyArray
    bx: AnyArray
    by: AnyArray


@dataclass(frozen=True, eq=False, kw_only=True)
class ModelStructure(ABC):
    """Equations with named states, inputs, outputs and parameters."""

    name: str  #: what tables call it
    #: (n,) names of the states; those that are channels may take their initial value from a record
    states: tuple[str, ...]
    inputs: tuple[str, ...]  #: (m,) input channels
    outputs: tuple[str, ...]  #: (p,) output channels
    parameters: tuple[Parameter, ...]  #: (k,) in the order of every parameter vector

    def __post_init__(self) -> None:
        for name in (*self.inputs, *self.outputs):
            channel(name)
        names = self.parameter_names
        if len(set(names)) != len(names):
            raise EstimationError(f"parameter names must differ, got {', '.join(names)}")

    @abstractmethod
    def derivative(self, x: AnyArray, u: AnyArray, params: AnyArray) -> AnyArray:
        """Return dx/dt, shape (..., n), of states (..., n), inputs (..., m) and parameters (..., k)."""

    @abstractmethod
    def output(self, x: AnyArray, u: AnyArray, params: AnyArray) -> AnyArray:
        """Return y, shape (..., p), of states (..., n), inputs (..., m) and parameters (..., k)."""

    @property
    def meaning(self) -> str:
        """The packaged structure whose parameters these are, by name; "" where what they mean is not known."""
        return self.name if self.name in STRUCTURE_NAMES else ""

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """(k,) names of all parameters."""
        return tuple(p.name for p in self.parameters)

    @property
    def values(self) -> FloatArray:
        """(k,) start values (free) and values (fixed)."""
        return np.array([p.value for p in self.parameters])

    @property
    def free(self) -> NDArray[np.bool_]:
        """(k,) which parameters are estimated."""
        return np.array([p.free for p in self.parameters], bool)

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds, (k,) each."""
        return np.array([p.low for p in self.parameters]), np.array([p.high for p in self.parameters])

    @property
    def trim_constants(self) -> tuple[str, ...]:
        """Parameters that hold what is left of trim values, which may well be nothing: their size says little."""
        return ()

    @property
    def begun(self) -> tuple[str, ...]:
        """States whose start the structure itself knows, whatever the record says."""
        return ()

    def initial_state(self, record: FlightRecord, measured: bool = True) -> FloatArray:
        """Return where the states (n,) begin: at the first sample of their channels, else, or unmeasured, at zero."""
        known = [measured and state in record for state in self.states]
        return np.array([record[s][0] if k else 0.0 for s, k in zip(self.states, known, strict=True)])

    @property
    def must_move(self) -> tuple[str, ...]:
        """Inputs that must move for the parameters to be found; others may stay constant."""
        return self.inputs

    @property
    def followers(self) -> tuple[str, ...]:
        """The last states, which inputs alone drive: no process noise moves them, and they begin at rest."""
        return ()

    def at_rest(self, u: FloatArray) -> FloatArray:
        """Return the states ``followers`` where the inputs (m,) have been constant."""
        return np.zeros(len(self.followers))

    def with_parameters(
        self,
        values: Mapping[str, float] | None = None,
        *,
        fixed: Iterable[str] = (),
        free: Iterable[str] | None = None,
        bounds: Mapping[str, tuple[float, float]] | None = None,
        prior_std: Mapping[str, float] | None = None,
    ) -> Any:
        """Return the structure with other start values, bounds or priors, and other parameters free.

        Args:
            values: name -> start value, or value of a fixed parameter.
            fixed: names that are held.
            free: the only names that are estimated; None leaves the others as they are.
            bounds: name -> (low, high).
            prior_std: name -> standard deviation of the prior around the start value.

        Raises:
            EstimationError: a name is not one of the structure's parameters, or a value breaks its bounds.
        """
        values, bounds, prior_std = dict(values or {}), dict(bounds or {}), dict(prior_std or {})
        fixed, wanted = set(fixed), None if free is None else set(free)
        for name in {*values, *bounds, *prior_std, *fixed, *(wanted or ())}:
            if name not in self.parameter_names:
                raise EstimationError(
                    f"a parameter of structure '{self.name}' must be one of {', '.join(self.parameter_names)}, got "
                    f"'{name}'{nearest(name, self.parameter_names)}"
                )
        out = []
        for p in self.parameters:
            low, high = bounds.get(p.name, (p.low, p.high))
            estimated = (p.free if wanted is None else p.name in wanted) and p.name not in fixed
            std = prior_std.get(p.name, p.prior_std)
            out.append(Parameter(p.name, values.get(p.name, p.value), estimated, low, high, std))
        return replace(self, parameters=tuple(out))

    def unpack(self, params: AnyArray) -> dict[str, AnyArray]:
        """Return name -> value with the leading axes of ``params`` (..., k), for readable equations."""
        return {name: params[..., i] for i, name in enumerate(self.parameter_names)}

    def jacobians(self, x: FloatArray, u: FloatArray, params: FloatArray) -> Jacobians:
        """Return the derivatives of f and h at one point, x (n,), u (m,), params (k,), by the complex step."""
        parts = [np.asarray(part, float) for part in (x, u, params)]
        z = np.concatenate(parts).astype(complex) + 1j * STEP * np.eye(sum(part.size for part in parts))
        n, m = parts[0].size, parts[1].size
        at = (z[:, :n], z[:, n : n + m], z[:, n + m :])
        f, h = self.derivative(*at).imag.T / STEP, self.output(*at).imag.T / STEP
        return Jacobians(f[:, :n], f[:, n : n + m], f[:, n + m :], h[:, :n], h[:, n : n + m], h[:, n + m :])

    def linearise(self, x: FloatArray, u: FloatArray, params: FloatArray) -> Matrices:
        """Return the linear model of deviations from the point x (n,), u (m,); bx and by are zero."""
        j = self.jacobians(x, u, params)
        return Matrices(j.fx, j.fu, j.hx, j.hu, np.zeros(len(self.states)), np.zeros(len(self.outputs)))


@dataclass(frozen=True, eq=False, kw_only=True)
class LinearStructure(ModelStructure):
    """A structure that is linear in states and inputs."""

    @property
    def trim_constants(self) -> tuple[str, ...]:
        """The constants of its equations."""
        return tuple(n for n in self.parameter_names if n.endswith("_0"))

    @abstractmethod
    def matrices(self, params: AnyArray) -> Matrices:
        """Return the matrices of parameters (..., k); analytic in them."""

    def derivative(self, x: AnyArray, u: AnyArray, params: AnyArray) -> AnyArray:
        """Return A x + B u + bx."""
        s = self.matrices(params)
        return np.einsum("...ij,...j->...i", s.A, x) + np.einsum("...ij,...j->...i", s.B, u) + s.bx

    def output(self, x: AnyArray, u: AnyArray, params: AnyArray) -> AnyArray:
        """Return C x + D u + by."""
        s = self.matrices(params)
        return np.einsum("...ij,...j->...i", s.C, x) + np.einsum("...ij,...j->...i", s.D, u) + s.by


@dataclass(frozen=True, eq=False)
class Affine:
    """The matrices of a linear structure as a sum over its parameters: base + sum of params_i slope_i."""

    base: FloatArray  #: (e,) entries of A, B, C, D, bx and by, one after the other
    slopes: FloatArray  #: (k, e)
    shapes: tuple[tuple[int, tuple[int, ...]], ...]  #: number of entries and shape of every matrix

    @classmethod
    def of(cls, structure: LinearStructure) -> Affine | None:
        """Return the sum, or None where parameters multiply or divide one another."""
        k = len(structure.parameters)
        size = np.maximum(np.abs(structure.values), 1.0)
        points = np.vstack([np.zeros(k), np.diag(size), size * np.cos(np.arange(k))])
        with np.errstate(all="ignore"):
            s = structure.matrices(points)
        if not all(np.all(np.isfinite(part)) for part in s):
            return None
        shapes = tuple(part.shape[1:] if part.ndim > 1 else part.shape for part in s)
        wide = [np.broadcast_to(part, (len(points), *shape)) for part, shape in zip(s, shapes, strict=True)]
        entries = np.concatenate([part.reshape(len(points), -1) for part in wide], axis=1)
        base, slopes = entries[0], (entries[1:-1] - entries[0]) / size[:, None]
        expected = base + points[-1] @ slopes
        right = np.abs(entries[-1] - expected) <= _AFFINE * (np.abs(base) + np.abs(points[-1]) @ np.abs(slopes))
        sized = tuple((int(np.prod(shape)), shape) for shape in shapes)
        return cls(base, slopes, sized) if bool(np.all(right)) else None

    def at(self, params: AnyArray) -> Matrices:
        """Return the matrices of parameters (..., k)."""
        entries = params @ self.slopes
        entries += self.base
        out, at, lead = [], 0, entries.shape[:-1]
        for size, shape in self.shapes:
            out.append(entries[..., at : at + size].reshape(lead + shape))
            at += size
        return Matrices(*out)
