"""What one log gives to the pool: the coefficients of its models, with what was left out and why."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from testbench.aircraft.model import SCALES
from testbench.core.advice import Advice, doubt, ranked
from testbench.core.errors import RecordError
from testbench.core.record import FloatArray
from testbench.estimators.parametric.model import ParametricModel
from testbench.evaluation.coefficients import PartialMass, Scaling, weights
from testbench.evaluation.derivatives import true_parameters
from testbench.line import Case
from testbench.pooling.least_squares import LogCoefficients
from testbench.pooling.scales import changes_by_scale
from testbench.questions.identify.derivatives import covariance_of
from testbench.questions.identify.flown import FlownCondition
from testbench.questions.identify.result import Identified

_COEFFICIENTS = "aerodynamic_longitudinal"  # the structure whose parameters are coefficients themselves
_SAID_BY_ERRORS = ("weakly_identifiable", "correlated_estimates")
"""Codes of advice on what one log decides little of: its covariance says so, and other logs may decide it."""
_OTHER_METHOD = "not the method that is pooled, {}"
_REFUSED = ("not converged", "at bound")


@dataclass(frozen=True, eq=False)
class Contribution:
    """What one log gives."""

    coefficients: LogCoefficients  # with their whole covariance
    derivative_of: dict[str, str]  # coefficient -> the derivative that it is made from
    # coefficient -> value in the model of the aircraft at the condition of the log; empty without one
    believed: dict[str, float]
    balance: tuple[tuple[str, str], ...]  # (derivative or model, why it is not in the pool)
    doubts: tuple[Advice, ...]  # what may make its coefficients wrong, in sentences

    @property
    def why_nothing(self) -> str:
        """Why the log gives no coefficient at all."""
        other = _OTHER_METHOD.format("")
        said = [f"{what}: {why}" for what, why in self.balance if not why.startswith(other)]
        return "; ".join(said) or "no estimator of that method has a structure"


def contribution(found: Identified, log: str, method: str | None = None) -> Contribution:
    """Return what the models of one description give.

    Models that have coefficients in common are not pooled, since they come from the same data: the first counts, or
    that of ``method``. What is in doubt is pooled with its errors; models that are not to be used and derivatives at a
    bound are left out.

    Args:
        found: of one description.
        log: what it is called.
        method: of the estimators that count; None for all.

    Raises:
        RecordError: airspeed, air or geometry is not known.
    """
    flown = found.flown
    assert flown is not None, "identify gives it"
    _known(flown, log)
    assert flown.V_m_s is not None
    assert flown.qbar_Pa is not None
    assert flown.geometry is not None
    scaling = Scaling(flown.V_m_s, flown.qbar_Pa, flown.geometry, flown.mass)
    names: list[str] = []
    blocks: list[tuple[FloatArray, FloatArray]] = []
    moved: list[dict[str, FloatArray]] = []
    derivative_of: dict[str, str] = {}
    believed: dict[str, float] = {}
    balance = [(cell.label, f"gave no model: {cell.reason}") for cell in found.failed]
    doubts = [doubt("several_conditions", text) for text in flown.doubts]
    doubts += [doubt("no_model", " ".join(said)) for said in balance if method is None]
    for i, case in enumerate(found.cases):
        why = _refused(case, method)
        if why:
            balance.append((case.label, why))
            continue
        assert isinstance(case.model, ParametricModel)
        kept: dict[str, tuple[str, FloatArray]] = {}
        for name, symbol, row, reason in _rows(case.model, scaling):
            belief = next((d.believed for d in found.derivatives if d.case == i and d.name == name), "")
            if symbol is None or row is None or belief in _REFUSED:
                balance.append((name, belief if belief in _REFUSED else reason))
            else:
                kept[symbol] = (name, row)
        common = [symbol for symbol in kept if symbol in names]
        if common:
            reason = (
                f"{', '.join(common)} come from the same data by another model; method = '...' under [pool] chooses"
            )
            balance.append((case.label, reason))
            continue
        if not kept:
            continue
        doubts += [a for a in ranked(case.model.advice) if a.severity == "doubt" and a.code not in _SAID_BY_ERRORS]
        H = np.stack([row for _, row in kept.values()])
        blocks.append((H @ case.model.params, H @ covariance_of(found.derivatives, i, case.model) @ H.T))
        moved.append(changes_by_scale(case.model, [name for name, _ in kept.values()], scaling))
        names += kept
        derivative_of |= {symbol: name for symbol, (name, _) in kept.items()}
        believed |= _believed(found, case.model, {name: symbol for symbol, (name, _) in kept.items()})
    covariance = np.zeros((len(names), len(names)))
    at = 0
    for values, block in blocks:
        covariance[at : at + len(values), at : at + len(values)] = block
        at += len(values)
    values = np.concatenate([np.zeros(0), *(v for v, _ in blocks)])
    moves = {q: np.concatenate([np.zeros(0), *(m[q] for m in moved)]) for q in SCALES}
    pooled = LogCoefficients(log, tuple(names), values, covariance, flown.at, moves)
    return Contribution(pooled, derivative_of, believed, tuple(balance), tuple(doubts))


def _known(flown: FlownCondition, log: str) -> None:
    if flown.geometry is None:
        raise RecordError(
            f"log '{log}' must have a reference area, chord and span for coefficients, got none; name an aircraft "
            "(aircraft = '...' or --aircraft), or give S_m2, b_m and cbar_m under [geometry]"
        )
    if flown.V_m_s is None:
        raise RecordError(
            f"log '{log}' must have an airspeed for coefficients, but its records hold none; give V_m_s under "
            "[condition], or condition = { V_m_s = ... } of the record"
        )
    if flown.qbar_Pa is None:
        raise RecordError(
            f"log '{log}' must have a dynamic pressure for coefficients, but its records hold neither it nor a height; "
            "give h_m or density_kg_m3 under [condition]"
        )


def _refused(case: Case, method: str | None) -> str:
    """Return why a model gives nothing to the pool; "" if it does."""
    if method is not None and case.estimator.method != method:
        return _OTHER_METHOD.format(method)
    if not isinstance(case.model, ParametricModel):
        return "has no derivatives"
    if not case.model.structure.meaning:
        return (
            "its equations do not state the meaning of their parameters: give the packaged structure that has them, "
            'as in means = "longitudinal"'
        )
    if case.model.status == "wrong":
        return f"must not be used: {next(a for a in ranked(case.model.advice) if a.severity == 'wrong')}"
    return ""


def _rows(model: ParametricModel, scaling: Scaling) -> Iterator[tuple[str, str | None, FloatArray | None, str]]:
    """Yield every free derivative, its coefficient, weights of the parameters, and why it has none."""
    names = model.structure.parameter_names
    for p in model.structure.parameters:
        if not p.free or (p.name.endswith("_0") and model.structure.name != _COEFFICIENTS):
            continue
        if model.structure.name == _COEFFICIENTS and p.name.startswith("C"):
            row = np.zeros(len(names))
            row[names.index(p.name)] = 1.0
            known = "_V" not in p.name
            yield p.name, p.name if known else None, row, "" if known else "is per reference speed of its own log"
            continue
        found = weights(model.structure.meaning, names, p.name, scaling)
        if found is not None:
            yield p.name, *found, ""
        else:
            yield p.name, None, None, _lacking(p.name, scaling.mass)


def _lacking(name: str, mass: PartialMass) -> str:
    needs = {"M": ("Iyy",), "L": ("Ixx", "Ixz"), "N": ("Izz", "Ixz")}
    axis, _, variable = name.partition("_")
    if variable in ("alpha", "beta", "p", "q", "r", "de", "da", "dr"):
        wanted = [f"{n}_kg_m2" for n in needs.get(axis, ()) if getattr(mass, n) is None]
        if axis in "XYZ" and mass.mass_kg is None:
            wanted = ["mass_kg"]
        if wanted:
            return f"needs {' and '.join(wanted)} under [condition]"
        return "its partner about the other axis is not in the structure, and Ixz is not zero"
    return "has no coefficient here: pooled are those by alpha, beta, rates and surfaces"


def _believed(found: Identified, model: ParametricModel, symbol_of: dict[str, str]) -> dict[str, float]:
    """Return coefficient -> value in the aircraft's model, by its own mass, where it was trimmed for this log."""
    known = found.before
    if known is None or not known.derivatives:
        return {}
    m, c = known.aircraft.mass, known.condition
    scaling = Scaling(c.V_m_s, c.qbar_Pa, known.aircraft.geometry, PartialMass(m.mass_kg, m.Ixx, m.Iyy, m.Izz, m.Ixz))
    told = true_parameters(model.structure.meaning, known.derivatives, c.V_m_s)
    names = tuple(told)
    values = np.array(list(told.values()))
    out = {}
    for name, symbol in symbol_of.items():
        made = weights(model.structure.meaning, names, name, scaling) if name in told else None
        if made is not None:
            out[symbol] = float(made[1] @ values)
    return out
