"""Identified models as files: JSON, MAT, and a JSBSim aerodynamics fragment.

The fragment is the model's own aerodynamics, in body axes. About a trim, F0 and M0 the aerodynamic forces and moments
that balance weight and thrust there, X, Y, Z and L, M, N the identified derivatives times the deviations from trim:

    F = F0 + m T [X Y Z]',    M = M0 + I [L M N]',

T turns the stability axes of the trim into body axes; L, M and N are angular accelerations, products of inertia
included, so that I = [[Ixx, 0, -Ixz], [0, Iyy, 0], [-Ixz, 0, Izz]] makes moments of them. The constants of the linear
structures (X_0, ...) are what was left of trim values: they are no aerodynamics and are left out. What an identified
X_V contains of the thrust's fall with airspeed is in the fragment; an engine model that knows it too counts it twice.
Coefficients as polynomials (structure ``aerodynamic_longitudinal``) are written as DRAG, LIFT and PITCH.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from testbench.core.channels import channel
from testbench.core.constants import FT_M, LBF_N, PSF_PA
from testbench.core.errors import EstimationError, RecordError
from testbench.estimators.model import IdentifiedModel
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.parametric.structures.aerodynamic import AerodynamicLongitudinal
from testbench.estimators.parametric.structures.lateral import LateralDirectional
from testbench.estimators.parametric.structures.longitudinal import FlexibleLongitudinal, Longitudinal


@dataclass(frozen=True, kw_only=True)
class MassProperties:
    """Mass in kg, moments of inertia about body axes through the centre of gravity in kg m2."""

    mass: float
    Ixx: float = 0.0
    Iyy: float = 0.0
    Izz: float = 0.0
    Ixz: float = 0.0


def save_json(model: IdentifiedModel, path: Path | str) -> Path:
    """Write ``model.to_dict()`` as JSON and return the path; raises RecordError if it cannot be written."""
    return _write(Path(path), (json.dumps(model.to_dict(), indent=1) + "\n").encode())


def save_mat(model: IdentifiedModel, path: Path | str) -> Path:
    """Write the model as one structure ``model`` of a MAT file (version 5), fields as in ``to_dict``; return the path.

    Matrices of numbers become matrices, lists of texts cell arrays; what is missing (null) becomes an empty matrix. The
    same model gives the same bytes.

    Raises:
        RecordError: the file cannot be written.
    """
    from scipy.io import savemat

    buffer = BytesIO()
    savemat(buffer, {"model": _matlab(model.to_dict())}, oned_as="column", long_field_names=True)
    text = "MATLAB 5.0 MAT-file, written by flight-testbench"  # without the time of day: same bytes
    return _write(Path(path), text.ljust(116).encode() + buffer.getvalue()[116:])


def save_jsbsim(
    model: IdentifiedModel,
    path: Path | str,
    mass: MassProperties,
    *,
    trim_controls: Mapping[str, float] | None = None,
    thrust_N: float = 0.0,
) -> Path:
    """Write :func:`jsbsim_aerodynamics` to a file and return its path; raises as that, or RecordError."""
    text = jsbsim_aerodynamics(model, mass, trim_controls=trim_controls, thrust_N=thrust_N)
    return _write(Path(path), text.encode())


def jsbsim_aerodynamics(
    model: IdentifiedModel,
    mass: MassProperties,
    *,
    trim_controls: Mapping[str, float] | None = None,
    thrust_N: float = 0.0,
) -> str:
    """Return the element ``<aerodynamics>`` of a JSBSim aircraft file.

    Args:
        model: of structure ``longitudinal`` with V among its states, ``lateral_directional`` or
            ``aerodynamic_longitudinal``; its controls are surfaces with a JSBSim property (de, da, dr).
        mass: mass and moments of inertia; ``aerodynamic_longitudinal`` has its own.
        trim_controls: deflection of each control in the trimmed flight, rad; 0 where not named.
        thrust_N: thrust in the trimmed flight, along body x.

    Raises:
        EstimationError: the model's structure does not say what forces act, a moment of inertia that it needs is not
            positive, or a control has no JSBSim property.
    """
    if isinstance(model, ParametricModel):
        s, controls = model.structure, trim_controls or {}
        if isinstance(s, AerodynamicLongitudinal):
            return _fragment(model, _polynomials(model, s))
        if isinstance(s, Longitudinal) and not isinstance(s, FlexibleLongitudinal) and "V" in s.states:
            return _fragment(model, _longitudinal(model, s, mass, controls, thrust_N))
        if isinstance(s, LateralDirectional):
            return _fragment(model, _lateral(model, s, mass, controls))
    name = model.structure.name if isinstance(model, ParametricModel) else model.method
    raise EstimationError(
        "a JSBSim aerodynamics fragment needs a model of structure longitudinal (with V), lateral_directional or "
        f"aerodynamic_longitudinal, got '{name}': its states do not say what forces act; estimate one of those"
    )


Term = tuple[float, Sequence[str]]  # factor, and properties or elements that it multiplies


def _longitudinal(
    model: ParametricModel, s: Longitudinal, mass: MassProperties, controls: Mapping[str, float], thrust_N: float
) -> dict[str, list[Term]]:
    _check(mass, "Iyy")
    t, v = s.trim, model.values
    c, z, weight = np.cos(t.alpha), np.sin(t.alpha), mass.mass * t.g
    trim = {"X": weight * np.sin(t.theta) - thrust_N, "Z": -weight * np.cos(t.theta), "PITCH": 0.0}
    out: dict[str, list[Term]] = {axis: [(value / LBF_N, ())] if value else [] for axis, value in trim.items()}
    for variable in ("V", "alpha", "q", *s.inputs):
        X, Z, M = (v.get(f"{symbol}_{variable.removesuffix('_cmd')}", 0.0) for symbol in "XZM")
        deviation = _deviation(variable, {"V": t.V, "alpha": t.alpha, **controls})
        out["X"].append((mass.mass * (c * X - z * Z) / LBF_N, deviation))
        out["Z"].append((mass.mass * (z * X + c * Z) / LBF_N, deviation))
        out["PITCH"].append((mass.Iyy * M / (LBF_N * FT_M), deviation))
    return out


def _lateral(
    model: ParametricModel, s: LateralDirectional, mass: MassProperties, controls: Mapping[str, float]
) -> dict[str, list[Term]]:
    _check(mass, "Ixx", "Izz")
    v = model.values
    out: dict[str, list[Term]] = {"Y": [], "ROLL": [], "YAW": []}
    for variable in ("beta", "p", "r", *s.inputs):
        Y, L, N = (v.get(f"{symbol}_{variable.removesuffix('_cmd')}", 0.0) for symbol in "YLN")
        deviation = _deviation(variable, controls)
        out["Y"].append((mass.mass * Y / LBF_N, deviation))
        out["ROLL"].append(((mass.Ixx * L - mass.Ixz * N) / (LBF_N * FT_M), deviation))
        out["YAW"].append(((mass.Izz * N - mass.Ixz * L) / (LBF_N * FT_M), deviation))
    return out


def _polynomials(model: ParametricModel, s: AerodynamicLongitudinal) -> dict[str, list[Term]]:
    a, v = s.airframe, model.values
    S = a.S_m * a.mass * PSF_PA / LBF_N  # times dynamic pressure in psf: lbf
    size = {"V": 1.0 / a.V0, "q": a.cbar / (2.0 * a.V0)}
    axes = {"CD": ("DRAG", S), "CL": ("LIFT", S), "Cm": ("PITCH", S * a.cbar / FT_M)}
    out: dict[str, list[Term]] = {}
    for coefficient, terms in s.terms.items():
        axis, factor = axes[coefficient]
        out[axis] = []
        for term in terms:
            variables = [] if term == "0" else term.split("*")
            scale = float(np.prod([size.get(x, 1.0) for x in variables]))
            value = v["_".join([coefficient, *(variables or ["0"])])]
            parts = [e for x in variables for e in _deviation(x, {})]
            out[axis].append((factor * scale * value, (_property("aero/qbar-psf"), *parts)))
    return out


def _check(mass: MassProperties, *needed: str) -> None:
    for name in ("mass", *needed):
        if not (np.isfinite(getattr(mass, name)) and getattr(mass, name) > 0.0):
            raise EstimationError(
                f"{name} > 0 must hold to make forces and moments of accelerations, got {getattr(mass, name)}"
            )


def _deviation(variable: str, trim: Mapping[str, float]) -> tuple[str, ...]:
    """Return the elements whose product is a variable's deviation from trim in SI units; commands are surfaces here."""
    name = variable.removesuffix("_cmd")
    known = channel(name)
    if known.jsbsim_property is None:
        raise EstimationError(f"a JSBSim fragment needs variables with a property there (de, da, dr), got '{variable}'")
    at = trim.get(variable, trim.get(name, 0.0))
    moved = _property(known.jsbsim_property)
    if at:
        moved = f"<difference>{moved}{_value(at / known.factor)}</difference>"
    return (moved,) if known.factor == 1.0 else (moved, _value(known.factor))


def _property(name: str) -> str:
    return f"<property>{name}</property>"


def _value(number: float) -> str:
    return f"<value>{float(number)!r}</value>"


def _fragment(model: ParametricModel, axes: Mapping[str, Sequence[Term]]) -> str:
    lines = ["<aerodynamics>"]
    for axis, terms in axes.items():
        lines.append(f" <axis name={quoteattr(axis)}>")
        kept = [(factor, parts) for factor, parts in terms if factor]
        for i, (factor, parts) in enumerate(kept, 1):
            name = quoteattr(f"aero/identified/{axis}-{i}")
            lines.append(f"  <function name={name}><product>{_value(factor)}{''.join(parts)}</product></function>")
        lines.append(" </axis>")
    source = f"identified by {model.method}, structure {model.structure.name}"
    return "\n".join([lines[0], f" <!-- {source} -->", *lines[1:], "</aerodynamics>", ""])


def _matlab(value: Any) -> Any:
    """Return JSON values as those that savemat writes: matrices of numbers, cells of texts, structures."""
    if isinstance(value, Mapping):
        return {_field(str(k)): _matlab(v) for k, v in value.items()} or np.zeros((0, 0))
    if value is None:
        return np.zeros((0, 0))
    if isinstance(value, (list, tuple)):
        try:
            numbers = np.array(value, float)
        except (TypeError, ValueError):
            cells = np.empty(len(value), object)
            cells[:] = [_matlab(v) for v in value]
            return cells
        return numbers if value else np.zeros((0, 0))
    return value


def _field(name: str) -> str:
    """Return a field name that MATLAB accepts: letters, digits, underscores; a letter first."""
    out = "".join(c if c.isalnum() and c.isascii() else "_" for c in name)
    return out if out[:1].isalpha() else f"x{out}"


def _write(path: Path, content: bytes) -> Path:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_name(path.name + ".part")
        part.write_bytes(content)
        part.replace(path)
    except OSError as error:
        raise RecordError(f"the model could not be written to '{path}': {error.strerror or error}") from error
    return path
