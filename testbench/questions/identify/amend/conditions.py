"""One motion at several speeds: what its identifications say together of the aircraft.

Every derivative is a factor on what the aircraft had at the condition of its records, by which its trend with speed is
that of the aircraft's model. The factors f_i with covariance P_i of all conditions together are

    f = P sum P_i^-1 f_i,    P^-1 = sum P_i^-1,

and if chi-square of the f_i about f is one that conditions which agree exceed in 1 % only, P grows by chi^2/dof.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2 as chi_square

from testbench.core.record import FloatArray
from testbench.estimators.parametric.model import ParametricModel
from testbench.page.words import listed
from testbench.questions.identify.derivatives import FoundDerivative, covariance_of
from testbench.questions.identify.result import Identified

_CHANCE = 0.01
_BELIEF = ("determined", "in doubt", "weak")
"""From the best to the worst; what is none of them is worse."""


class Told(NamedTuple):
    """An identification at one condition and the number of its case.

    ``doubts`` are sentences on conditions that disagree; ``others`` the identifications at other conditions that it
    speaks for.
    """

    found: Identified
    case: int
    doubts: tuple[str, ...] = ()
    others: tuple[tuple[Identified, int], ...] = ()

    @property
    def model(self) -> ParametricModel:
        """The model of the case."""
        model = self.found.cases[self.case].model
        assert isinstance(model, ParametricModel)
        return model


def together(told: Sequence[Told]) -> list[Told]:
    """Return one of the identifications of each motion, with what all of that motion say at its condition.

    Identifications belong together if their models have the same derivatives; that of the middle speed is returned.
    """
    groups: dict[tuple[str, tuple[str, ...]], list[Told]] = {}
    for one in told:
        names = tuple(p.name for p in one.model.structure.parameters if p.free)
        groups.setdefault((one.model.structure.meaning, names), []).append(one)
    return [group[0] if len(group) == 1 else _pooled(group) for group in groups.values()]


def _pooled(group: Sequence[Told]) -> Told:
    middle = sorted(group, key=_speed)[len(group) // 2]
    own = {d.name: d for d in _derivatives(middle)}
    names = [n for n, d in own.items() if all(_before(one, n) for one in group) and d.std > 0.0]
    factors, information = [], []
    for one in group:
        at = [one.model.structure.parameter_names.index(n) for n in names]
        before = np.array([_before(one, n) for n in names])
        P = covariance_of(one.found.derivatives, one.case, one.model)[np.ix_(at, at)] / np.outer(before, before)
        factors.append(np.array([{d.name: d.value for d in _derivatives(one)}[n] for n in names]) / before)
        information.append(_inverse(P))
    P = _inverse(np.sum(information, axis=0))
    f = P @ np.sum([M @ x for M, x in zip(information, factors, strict=True)], axis=0)
    chi2 = float(sum((x - f) @ M @ (x - f) for M, x in zip(information, factors, strict=True)))
    dof = len(names) * (len(group) - 1)
    doubts: tuple[str, ...] = ()
    if chi_square.sf(chi2, dof) < _CHANCE:
        P = P * chi2 / dof
        doubts = (
            f"{listed([one.found.name for one in group])} differ by {np.sqrt(chi2 / dof):.2g} times their errors: "
            "the aircraft changes with speed otherwise than its model, or the records hold what they do not show",
        )
    return _read(middle, group, names, f, P, doubts)


def _read(
    middle: Told, group: Sequence[Told], names: Sequence[str], f: FloatArray, P: FloatArray, doubts: tuple[str, ...]
) -> Told:
    """Return the middle identification with factors (k,) and their covariance (k, k) in place of its own."""
    model = middle.model
    at = [model.structure.parameter_names.index(n) for n in names]
    before = np.array([_before(middle, n) for n in names])
    params, covariance = model.params.copy(), np.diag(np.diag(model.covariance))
    params[at], covariance[np.ix_(at, at)] = f * before, P * np.outer(before, before)
    std = dict(zip(names, np.sqrt(np.diag(P)) * np.abs(before), strict=True))
    value = dict(zip(names, (f * before).tolist(), strict=True))
    beliefs = {n: _best([d.believed for one in group for d in _derivatives(one) if d.name == n]) for n in names}
    derivatives = tuple(
        replace(d, value=value[d.name], std=float(std[d.name]), stated=float(std[d.name]), believed=beliefs[d.name])
        if d.case == middle.case and d.name in value
        else d
        for d in middle.found.derivatives
    )
    cases = list(middle.found.cases)
    cases[middle.case] = replace(cases[middle.case], model=replace(model, params=params, covariance=covariance))
    others = tuple((one.found, one.case) for one in group if one is not middle)
    return Told(replace(middle.found, cases=tuple(cases), derivatives=derivatives), middle.case, doubts, others)


def _derivatives(one: Told) -> list[FoundDerivative]:
    return [d for d in one.found.derivatives if d.case == one.case]


def _before(one: Told, name: str) -> float:
    """Return what the aircraft had; 0 if that is not known, or nothing that a factor could be of."""
    d = next((d for d in _derivatives(one) if d.name == name), None)
    return 0.0 if d is None or d.before is None or abs(d.before) <= 1e-3 * d.std else d.before


def _speed(one: Told) -> float:
    assert one.found.before is not None
    return one.found.before.condition.V_m_s


def _best(beliefs: Sequence[str]) -> str:
    return min(beliefs, key=lambda b: _BELIEF.index(b) if b in _BELIEF else len(_BELIEF))


def _inverse(P: FloatArray) -> FloatArray:
    size = np.sqrt(np.diag(P))
    return np.asarray(np.linalg.pinv(P / np.outer(size, size), rcond=1e-12, hermitian=True) / np.outer(size, size))
