"""What is believed of coefficients before the logs: from an aircraft's model, a file, or an earlier pooling."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from testbench.aircraft import Aircraft
from testbench.aircraft.geometry.coefficients import ROWS, relative_deviation
from testbench.core.door import read_json, read_toml
from testbench.core.errors import EstimationError, RecordError, ScenarioError, nearest
from testbench.core.record import FloatArray
from testbench.core.schema import Positive, Strict, parse

_NOTHING = 1e-9  # a coefficient that differences find and that is smaller is zero
_SLOPE = 5.0  # CL_alpha of an aircraft of which it is not known
_VARIABLES = ("alpha", "beta", "p", "q", "r", "de", "da", "dr")
NAMES = tuple(f"{c}_{v}" for c in ("CX", "CY", "CZ", "CL", "CD", "Cl", "Cm", "Cn") for v in _VARIABLES)
"""The coefficients that logs may give: CX and CZ, or CL and CD from a structure of coefficients."""


@dataclass(frozen=True, eq=False)
class Prior:
    """What is believed of some coefficients: their information matrix is the inverse of ``covariance``.

    Attributes:
        names: (k,) of the coefficients.
        values: (k,) believed.
        covariance: (k, k), positive definite.
        source: whose belief it is.
        notes: what was assumed or left out, in sentences.

    Raises:
        EstimationError: shapes do not agree, or the covariance is not positive definite.

    Example:
        >>> import numpy as np
        >>> import testbench as tb
        >>> prior = tb.Prior(("Cm_q", "Cm_alpha"), np.array([-12.0, -0.7]), np.diag([3.6**2, 0.14**2]), "handbook")
        >>> prior.of(["Cm_alpha"]).values.tolist()
        [-0.7]
    """

    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    source: str
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        k, y, P = len(self.names), np.array(self.values, float), np.array(self.covariance, float)
        good = y.shape == (k,) and P.shape == (k, k) and len(set(self.names)) == k
        good = good and bool(np.all(np.isfinite(y)) and np.all(np.isfinite(P)) and np.allclose(P, P.T, rtol=1e-9))
        if good and k:
            size = np.sqrt(np.maximum(np.diag(P), 0.0))
            good = bool(np.all(size > 0.0)) and np.linalg.eigvalsh(P / np.outer(size, size))[0] > 0.0
        if not good:
            raise EstimationError(
                f"the prior of {self.source} must have one finite value per coefficient, each once, and a covariance "
                f"that is symmetric and positive definite, got {list(self.names)}, values {y.tolist()}, covariance "
                f"{P.tolist()}"
            )
        y.flags.writeable = P.flags.writeable = False
        object.__setattr__(self, "values", y)
        object.__setattr__(self, "covariance", P)

    def of(self, names: Sequence[str]) -> Prior:
        """Return the prior of some of the coefficients, nothing being known of the others."""
        at = [self.names.index(name) for name in names]
        return Prior(tuple(names), self.values[at], self.covariance[np.ix_(at, at)], self.source, self.notes)


def prior_of_aircraft(aircraft: Aircraft, believed: Mapping[str, float], handbook: bool = False) -> Prior:
    """Return the prior of an aircraft's model: its coefficients, each with a relative standard deviation of its own.

    The deviation is the one that the aircraft states (``[uncertainty]`` of aircraft.toml, which an aircraft made from
    its geometry has), else that of coefficients from a geometry. CZ takes that of CL, CX
    that of CD. The coefficients are taken as independent of each other.

    Args:
        aircraft: whose model it is.
        believed: coefficient -> value in the model.
        handbook: leave out of account what the aircraft states.
    """
    stated: Mapping[str, float] = {} if handbook else aircraft.uncertainty
    relative, notes, zero, unknown, general = dict[str, float](), [], [], [], []
    slope = next((abs(v) for n, v in believed.items() if _key(n) == "CL_alpha" and v), _SLOPE)
    for name, value in believed.items():
        key = _key(name)
        if abs(value) < _NOTHING:
            zero.append(name)
        elif key in stated:
            relative[name] = stated[key]
        elif key in ROWS:
            relative[name] = relative_deviation(key, value, slope)
            general.append(f"{name} {100.0 * relative[name]:.0f} %")
        else:
            unknown.append(name)
    if general:
        who = "" if handbook else f"; {aircraft.name} states none of its own for them"
        notes.append(f"handbook deviations were taken for {', '.join(general)}{who}")
    if zero:
        notes.append(f"no prior of {', '.join(zero)}: zero in {aircraft.name}, and a deviation is a share of the value")
    if unknown:
        notes.append(f"no prior of {', '.join(unknown)}: no deviation is known for it")
    source = f"{aircraft.name} with handbook deviations" if handbook else aircraft.name
    values = np.array([believed[name] for name in relative])
    variances = np.square(values * np.array(list(relative.values())))
    return Prior(tuple(relative), values, np.diag(variances), source, tuple(notes))


def _key(name: str) -> str:
    """Return the name of the coefficient whose deviation counts."""
    axis, _, variable = name.partition("_")
    if axis == "CX":
        return "CD"
    return f"CL_{variable}" if axis == "CZ" else name


class _Believed(Strict):
    value: float
    std: Positive | None = None
    percent: Positive | None = None

    @model_validator(mode="after")
    def _one_deviation(self) -> _Believed:
        if (self.std is None) == (self.percent is None):
            raise ValueError("give either std or percent (of the value), one standard deviation")
        if self.percent is not None and self.value == 0.0:
            raise ValueError("percent says nothing of a value of 0; give std")
        return self

    @property
    def deviation(self) -> float:
        """One standard deviation."""
        return self.std if self.std is not None else abs(self.value) * (self.percent or 0.0) / 100.0


class PriorFile(Strict):
    """A prior in a file: values of coefficients with standard deviations, and their source."""

    source: Annotated[str, Field(min_length=1)]
    coefficient: Annotated[dict[str, _Believed], Field(min_length=1)]


def prior_of_file(path: Path, at: Mapping[str, float] | None = None) -> Prior:
    """Return the prior that a TOML file gives, or the pooled.json of an earlier pooling, with its whole covariance.

    Args:
        path: of the file.
        at: variable -> where the logs are that it is a prior of, SI: coefficients of an earlier pooling that have a
            slope are taken there. Where it is not known, they are taken where that pooling gave them.

    Raises:
        RecordError: the file cannot be read.
        ScenarioError: it breaks its schema, or names what is no coefficient.
        EstimationError: its covariance is none.
    """
    if path.suffix.lower() == ".json":
        return _earlier(path, at or {})
    said, faults = parse(PriorFile, read_toml(path, "prior"), path)
    if said is None or faults:
        raise ScenarioError(faults)
    _check(tuple(said.coefficient), path)
    values = np.array([c.value for c in said.coefficient.values()])
    variance = np.square([c.deviation for c in said.coefficient.values()])
    return Prior(tuple(said.coefficient), values, np.diag(variance), said.source)


def _earlier(path: Path, at: Mapping[str, float]) -> Prior:
    content = read_json(path, "pooled")
    try:
        names = tuple(str(name) for name in content["coefficients"])
        values = np.array([float(v) for v in content["coefficients"].values()])
        slopes = {str(name): float(v) for name, v in content["slopes"].items()}
        covariance = np.array(content["covariance_with_slopes"], float)
        variable, reference = str(content["trend"]["variable"]), float(content["trend"]["reference"])
        logs = [str(log) for log in content["logs"]]
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise RecordError(
            f"a prior in JSON must be the pooled.json of an earlier pooling, but '{path}' is none ({error!r})"
        ) from error
    _check(names, path)
    notes = [f"if one of the logs {', '.join(logs)} is among these, it is counted twice"]
    if content.get("scale_uncertainty"):
        notes.append(
            f"its errors hold those of {', '.join(content['scale_uncertainty'])}; if the new logs share them, what is "
            "said of both together is too good"
        )
    J = np.eye(len(names), len(names) + len(slopes))
    if slopes and set(slopes) <= set(names) and covariance.shape == (J.shape[1], J.shape[1]):
        for k, name in enumerate(slopes):
            J[names.index(name), len(names) + k] = at.get(variable, reference) - reference
        values = J @ np.concatenate([values, list(slopes.values())])
        there = at.get(variable, reference)
        notes.append(f"the prior of {', '.join(slopes)} has a slope over {variable} and is taken at {there:.4g}")
    if covariance.shape == (J.shape[1], J.shape[1]):
        covariance = J @ covariance @ J.T
    return Prior(names, values, covariance, f"{path.name} ({', '.join(logs)})", tuple(notes))


def _check(names: Sequence[str], path: Path) -> None:
    strange = [name for name in names if name not in NAMES]
    if strange:
        raise ScenarioError(
            [
                f"{path}, coefficient.{name}: must be a coefficient such as Cm_alpha or CZ_alpha (= -CL_alpha - CD)"
                f"{nearest(name, NAMES)}"
                for name in strange
            ]
        )
