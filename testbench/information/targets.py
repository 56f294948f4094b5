"""The targets of a design: parameters with a wanted accuracy, and modes with frequency and damping."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.errors import EstimationError, nearest
from testbench.core.record import FloatArray
from testbench.estimators.parametric.structure import STEP
from testbench.evaluation.modes import elastic_modes
from testbench.information.aircraft_structure import AircraftStructure
from testbench.information.fisher import Accuracy

_RIGID = {
    "longitudinal": ("Z_alpha", "M_alpha", "M_q"),
    "lateral": ("Y_beta", "L_beta", "L_p", "L_r", "N_beta", "N_p", "N_r"),
}
_BY_CONTROL = {"longitudinal": ("Z", "M"), "lateral": ("L", "N")}


@dataclass(frozen=True, eq=False)
class Targets:
    """Quantities to be known: linear functions, near the truth, of the parameters."""

    names: tuple[str, ...]  # (t,) e.g. "M_alpha" or "wn of short period".
    values: FloatArray  # (t,) true values
    wanted: FloatArray  # (t,) wanted standard errors, same units
    jacobian: FloatArray  # (t, k) derivatives by the parameters
    # mode -> its pole, or the two real roots that it has split into; those of the names "wn of", "zeta of"
    modes: Mapping[str, complex | tuple[complex, complex]] = field(default_factory=dict)

    def at(self, structure: AircraftStructure, params: FloatArray) -> FloatArray:
        """Return the targets (t,) of other parameters (k,), modes by the poles that lie nearest to the true ones."""
        poles = np.linalg.eigvals(structure.matrices(params).A)
        none = np.zeros((len(poles), 0))
        found = dict(zip(structure.parameter_names, params.tolist(), strict=True))
        for name, aim in self.modes.items():
            roots = [s for s, _ in _roots(poles, none, aim if isinstance(aim, tuple) else (aim,))]
            square = (roots[0] * (roots[1] if len(roots) == 2 else np.conj(roots[0]))).real
            total = (roots[0] + (roots[1] if len(roots) == 2 else np.conj(roots[0]))).real
            wn = math.sqrt(square) if square > 0.0 else math.nan
            found |= {f"wn of {name}": wn, f"zeta of {name}": -0.5 * total / wn if wn else math.nan}
        return np.array([found[name] for name in self.names])

    def slopes(
        self, structure: AircraftStructure, params: FloatArray, moving: Sequence[int] | None = None
    ) -> FloatArray:
        """Return the derivatives (t, k) of the targets at other parameters (k,), by central differences.

        Those by parameters that are not ``moving`` are zero; all move if it is not given.
        """
        out = np.zeros((len(self.names), params.size))
        for k in range(params.size) if moving is None else moving:
            step = np.zeros(params.size)
            step[k] = 1e-6 * max(abs(params[k]), 1e-6)
            high, low = (self.at(structure, params + sign * step) for sign in (1.0, -1.0))
            out[:, k] = (high - low) / (2.0 * step[k])
        return out

    @property
    def gradient(self) -> FloatArray:
        """(t, k) targets in units of their wanted errors by the parameters."""
        return self.jacobian / self.wanted[:, None]

    def errors(self, known: Accuracy) -> FloatArray:
        """Return the standard errors (t,) of the targets; inf if a parameter that counts is unknown."""
        out = np.sqrt(np.einsum("ti,ij,tj->t", self.jacobian, known.covariance, self.jacobian))
        return np.where(np.any(self.jacobian[:, np.isinf(known.std)] != 0.0, axis=1), np.inf, out)


def needed_parameters(plane: str, controls: Sequence[str], slow: bool, elastic: Sequence[int]) -> tuple[str, ...]:
    """Return the parameters that must be free to estimate modes, so that nothing that matters is taken as known.

    Args:
        plane: "longitudinal" or "lateral".
        controls: controls that move.
        slow: whether the phugoid is a target; it depends on the derivatives by speed.
        elastic: numbers of the elastic modes that are targets.
    """
    out = [*_RIGID[plane]]
    out += [f"{axis}_{c}" for c in controls for axis in ("X" if c == "thr" else _BY_CONTROL[plane])]
    if slow:
        out += ["X_V", "Z_V", "M_V", "X_alpha"]
    for i in elastic:
        out += [f"omega_{i}", f"zeta_{i}", *(f"Q{i}_{c}" for c in controls if c != "thr")]
        out += [f"Q{i}_alpha"] if plane == "longitudinal" else [f"Q{i}_p"]
    return tuple(out)


def unknowns(
    aircraft: Aircraft, plane: str, controls: Sequence[str], modes: Sequence[str], parameters: Sequence[str]
) -> tuple[str, ...]:
    """Return the parameters that must be free for modes (by their names) and parameters to be found."""
    numbers = [
        i
        for i, name in elastic_modes(aircraft, plane).items()
        if name in modes or any(p in (f"omega_{i}", f"zeta_{i}") or p.startswith(f"Q{i}_") for p in parameters)
    ]
    return tuple(dict.fromkeys([*needed_parameters(plane, controls, "phugoid" in modes, numbers), *parameters]))


def targets(
    structure: AircraftStructure,
    parameters: Mapping[str, float],
    modes: Mapping[str, complex | tuple[complex, complex]],
    mode_accuracy: tuple[float, float],
) -> Targets:
    """Return the targets of a design.

    Args:
        structure: with every parameter that is estimated, free.
        parameters: name -> wanted standard error relative to the true value.
        modes: name -> true pole, rad/s, of the modes that are targets; or the two real roots s1, s2 that an oscillation
            has split into, which keeps its natural frequency sqrt(s1 s2) and damping ratio -(s1 + s2) / (2 wn).
        mode_accuracy: wanted relative error of the natural frequency, and error of the damping ratio.

    Raises:
        EstimationError: a parameter is not among the structure's, or its true value is zero; or one of the two roots
            of a mode grows.
    """
    known = structure.parameter_names
    names, values, wanted, rows = [], [], [], []
    for name, relative in parameters.items():
        if name not in known:
            raise EstimationError(f"a target must be one of {', '.join(known)}; got '{name}'{nearest(name, known)}")
        k = known.index(name)
        if structure.true[k] == 0.0:
            raise EstimationError(f"the true value of '{name}' is zero: no relative accuracy can be wanted of it")
        names.append(name)
        values.append(structure.true[k])
        wanted.append(relative * abs(structure.true[k]))
        rows.append(np.eye(len(known))[k])
    poles, slopes = pole_sensitivities(structure)
    for name, found in modes.items():
        if isinstance(found, tuple):
            (a, da), (b, db) = _roots(poles, slopes, found)
            if not (a * b).real > 0.0:
                raise EstimationError(f"the {name} has split into real roots of which one grows: it has no frequency")
            wn = math.sqrt((a * b).real)
            d_wn, zeta, d_sum = (a * db + b * da).real / (2.0 * wn), -(a + b).real / (2.0 * wn), (da + db).real
            quantities = [(wn, d_wn), (zeta, -d_sum / (2.0 * wn) - zeta * d_wn / wn)]
        else:
            ((s, d),) = _roots(poles, slopes, (found,))
            wn = abs(s)
            d_wn = (np.conj(s) * d).real / wn
            quantities = [(wn, d_wn)]
            if abs(s.imag) > 1e-9 * wn:  # a real root has no damping ratio to speak of
                quantities.append((-s.real / wn, -d.real / wn + s.real * d_wn / wn**2))
        for of, error, (value, row) in zip(
            ("wn", "zeta"), (mode_accuracy[0] * wn, mode_accuracy[1]), quantities, strict=False
        ):
            names.append(f"{of} of {name}")
            values.append(value)
            wanted.append(error)
            rows.append(row)
    if not names:
        raise EstimationError("a design needs at least one target: parameters or modes")
    return Targets(tuple(names), np.array(values), np.array(wanted), np.array(rows), dict(modes))


def _roots(poles: np.ndarray, slopes: np.ndarray, near: Sequence[complex]) -> list[tuple[complex, np.ndarray]]:
    """Return the roots (and their derivatives (k,)) that lie nearest to some poles, a different one for each."""
    out, left = [], list(range(len(poles)))
    for pole in near:
        at = min(left, key=lambda i: abs(poles[i] - pole))
        left.remove(at)
        out.append((complex(poles[at]), slopes[at]))
    return out


def pole_sensitivities(structure: AircraftStructure) -> tuple[np.ndarray, np.ndarray]:
    """Return the poles (n,) at the true parameters and their derivatives (n, k): d s = l' dA r / l' r."""
    k = len(structure.parameters)
    z = structure.true + 1j * STEP * np.eye(k)
    dA = structure.matrices(z).A.imag / STEP
    poles, right = np.linalg.eig(structure.A0)
    left = np.linalg.inv(right)
    return poles, np.einsum("si,kij,js->sk", left, dA, right)
