"""What derivatives that are no constants do to estimates of a linear model: its error of form, with a prior.

The derivatives of an aircraft go with the angle of attack and with dynamic pressure. A linear model that is fitted to a
manoeuvre has a mean of them over what was flown, whose residuals may look like noise; at trim they are others. To first
order every derivative is p + p_0 sum_j c_j s_j(t), of the size p_0 of p and of what cancels in it, with schedules s(t)
from the flight itself: alpha over 0.1 rad, its square, that of beta, and the share by which dynamic pressure is above
that of trim. The coefficients c have a prior and
are estimated beside the parameters; those are then

    theta = theta_linear - G E[c],     P = P_linear + G cov(c) G',

G how far they are moved by each c (the consider analysis of :mod:`.considered`). That effects of alpha go with dynamic
pressure, and those of rates with speed, is known: the mean of its prior.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from testbench.core.advice import Advice, note, ranked
from testbench.core.constants import WHITE
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.parametric.accuracy import whiteness
from testbench.estimators.parametric.likelihood import Likelihood
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.parametric.response import respond, scheduled
from testbench.estimators.parametric.structure import LinearStructure
from testbench.estimators.structured import per_speed
from testbench.inference.considered import at_rest

ALPHA_RAD = 0.1
"""Angle of attack or sideslip from trim over which ``alpha`` of the prior counts."""
FORM_STD = {"alpha": 0.5, "qbar": 0.75}
"""Standard deviations of the prior where nothing is known: set on 21 drawn flights, judged on others."""
WITH_QBAR = 0.75
"""Mean of the prior: derivatives go with dynamic pressure as this share of it: 1 for angles, 1/2 for rates and V."""
BY_INPUT = frozenset({"delay", "lag", "rate_limit", "held", "order_too_low", "elastic_mode", "closed_loop"})
"""Causes of residuals that go with the inputs."""


def formed(
    model: ParametricModel, records: Sequence[FlightRecord], form_std: Mapping[Any, float], V_m_s: float
) -> ParametricModel:
    """Return a model with the derivatives at trim, and in their covariance what the form of the linear one hides.

    Records say how far derivatives vary as well as their residuals are white; of a filter's, which follow the
    aircraft whatever moves it, nothing is taken but the prior.

    Args:
        model: linear, by output error or filter error; others are returned as they are.
        records: prepared, that it was identified from.
        form_std: "alpha" -> standard deviation of the share by which derivatives vary over 0.1 rad, "qbar" -> of that
            by which they vary over the share of dynamic pressure. What is not named does not vary.
        V_m_s: true airspeed at trim, m/s.

    Raises:
        EstimationError: the records do not decide the parameters.

    Example:
        >>> model = tb.estimate("output_error", [record], ["de"], ["alpha", "q"])  # doctest: +SKIP
        >>> formed(model, [record], {"alpha": 0.5, "qbar": 0.75}, 50.0).values["M_alpha"]  # doctest: +SKIP
        -35.5
    """
    structure = model.structure
    if (
        not form_std
        or model.method not in ("output_error", "filter_error")
        or not isinstance(structure, LinearStructure)
    ):
        return model
    likelihood = Likelihood.of(model, records)
    chosen = likelihood.layout.chosen
    whiten = np.linalg.inv(np.linalg.cholesky(model.noise_covariance))
    point, (left, slopes) = at_rest(likelihood, model.params, whiten)
    means, stds, columns = np.zeros(0), np.zeros(0), []
    for i, (stretch, record) in enumerate(zip(likelihood.stretches, records, strict=True)):
        own = likelihood.layout.split(point, i)
        x0 = likelihood.layout.begin(own.initial, stretch.x0)
        flown = likelihood.driven(stretch.u, own), likelihood.sampling, x0
        x = respond(structure, model.params, [], *flown).x
        schedules, means, stds = _schedules(structure.states, x, record, form_std, V_m_s)
        with_qbar = bool(means[-1:].any())
        moved = scheduled(structure, model.params, chosen.tolist(), *flown, schedules)
        sizes = np.column_stack([_sizes(model, V_m_s)[chosen]] * (len(stds) - with_qbar))
        sizes = np.column_stack([sizes, model.params[chosen]]) if with_qbar else sizes
        moved *= np.where(stretch.valid[:, :, None, None], sizes * stds, 0.0)
        columns.append(np.einsum("ij,njfq->nifq", whiten, moved).reshape(-1, chosen.size * stds.size))
    if not stds.size:
        return model
    B, each = np.vstack(columns), np.tile(means / stds, chosen.size)
    pseudo = np.linalg.pinv(slopes, rcond=1e-10)
    G = -(pseudo @ B)
    across, left = B + slopes @ G, left - slopes @ (pseudo @ left)  # what no other parameters do in its place

    def given(inflation: float) -> tuple[FloatArray, FloatArray]:
        """Return mean and covariance of the coefficients, of whose data so many standard errors are one."""
        covariance = np.linalg.inv(across.T @ across / inflation**2 + np.eye(each.size))
        return covariance @ (across.T @ left / inflation**2 + each), covariance

    mean, covariance = given(1.0)
    ends = np.cumsum([s.y.size for s in likelihood.stretches])[:-1]
    rest = [part.reshape(-1, len(model.outputs)) for part in np.split(left - across @ mean, ends)]
    unit = np.eye(len(model.outputs))
    chances = whiteness(rest, [s.valid for s in likelihood.stretches], np.diag(unit), unit)
    noise = bool(np.all(chances > WHITE))
    if model.method == "filter_error":
        mean, covariance = each, np.eye(each.size)
    elif not noise:
        mean, covariance = given(float(np.max(model.diagnostics.get("error_inflation", 1.0), initial=1.0)))
    model = _explained(model, chances if noise else None)
    params, added = model.params.copy(), np.zeros_like(model.covariance)
    params[chosen] -= G[: chosen.size] @ mean
    added[np.ix_(chosen, chosen)] = G[: chosen.size] @ covariance @ G[: chosen.size].T
    return replace(model, params=params, covariance=model.covariance + added)


def _sizes(model: ParametricModel, V_m_s: float) -> FloatArray:
    """Return by what size (k,) each derivative varies with the angles: its own, and that of what may cancel in it.

    M_alpha is the small difference of moments of wing and tail: a neutral point that moves by as much as lies between
    it and the manoeuvre point changes it by M_q Z_alpha / V. X_alpha is that of drag and of lift that leans forward,
    which leans by twice the angle: CX = CL sin(alpha) - CD cos(alpha), CX_alphaalpha = 2 CL_alpha.
    """
    values, name = dict(zip(model.structure.parameter_names, model.params, strict=True)), model.structure.meaning
    force = {axis: 1.0 if per_speed(name, axis) else V_m_s for axis in "YZ"}
    beside = {
        "M_alpha": values.get("M_q", 0.0) * values.get("Z_alpha", 0.0) / force["Z"],
        "N_beta": values.get("N_r", 0.0) * values.get("Y_beta", 0.0) / force["Y"],
        "X_alpha": 2.0 * ALPHA_RAD * values.get("Z_alpha", 0.0) * V_m_s / force["Z"],
    }
    return np.array([math.hypot(v, beside.get(n, 0.0)) for n, v in values.items()])


def _explained(model: ParametricModel, chances: FloatArray | None) -> ParametricModel:
    """Return a model without what was said of residuals that varying derivatives explain.

    Its errors hold a bend. Where nothing but noise is left (``chances``), they hold all that was coloured before; else
    what was found behind a bend may be more of it. What goes with the inputs, such as a servo, is no variation of
    derivatives, although that can imitate it.
    """
    found, causes = dict(model.diagnostics), [c["code"] for c in model.diagnostics.get("causes", ())]
    driven = bool(BY_INPUT.intersection(causes))
    found["formed"] = chances is not None and not driven
    gone = {"bend"}
    if chances is not None and not driven and np.any(np.asarray(found["whiteness_p"]) < WHITE):
        gone |= {*causes, "coloured_residuals"}
        found |= {"whiteness_p": chances, "error_inflation": np.ones_like(found["error_inflation"])}
        model = replace(model, covariance=model.covariance_plain)
    found["causes"] = [c for c in found.get("causes", ()) if c["code"] not in gone]
    advice = []
    for one in ranked(model.advice):
        if one.code not in gone:
            behind = "bend" in causes and one.code in causes
            advice.append(Advice(one, "doubt", one.code) if behind and one.severity == "wrong" else one)
    if len(advice) < len(model.advice):
        advice.append(
            note(
                "form",
                "its derivatives vary with angle of attack and dynamic pressure during the flight: those at trim are "
                "given, with errors that include this",
            )
        )
    return replace(model, advice=tuple(advice), diagnostics=found)


def _schedules(
    states: Sequence[str], x: FloatArray, record: FlightRecord, form_std: Mapping[Any, float], V_m_s: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the schedules (n, q) of one record, and mean and standard deviation (q,) of the prior of each."""
    columns: list[FloatArray] = []
    prior: list[tuple[float, float]] = []
    along = form_std.get("alpha", 0.0)
    for angle, speed in (("alpha", "w"), ("beta", "v")) if along > 0.0 else ():
        if angle in states:
            moved = x[:, states.index(angle)]
        elif speed in states:
            moved = x[:, states.index(speed)] / V_m_s
        elif angle in record:
            moved = record[angle]
        else:
            continue
        powers = (1, 2) if angle == "alpha" else (2,)  # either side is alike
        columns += [(moved / ALPHA_RAD) ** power for power in powers]
        prior += [(0.0, along)] * len(powers)
    if form_std.get("qbar", 0.0) > 0.0 and "V" in record:
        removed = record.provenance.get("prepared", {}).get("removed", {}).get("V", 0.0)
        V = removed + record["V"]
        columns.append((V / (removed if removed > 0.0 else float(np.mean(V)))) ** 2 - 1.0)
        prior.append((WITH_QBAR, form_std["qbar"]))
    means, stds = np.array(prior).reshape(-1, 2).T
    return np.column_stack([np.zeros((len(record), 0)), *columns]), means, stds
