"""The answer of a pooling: the coefficients, what contradicts, whether the logs agree, and what the data added."""

from __future__ import annotations

from testbench.core.constants import DEG_RAD
from testbench.page.labels import number
from testbench.page.words import Line, counted, listed, sentence, some
from testbench.pooling.pool import CRITERIA, Cause, Pooled, PooledCoefficient
from testbench.questions.identify.pool.ask import PooledFlights

_MOST = 8
_FEW = 5  # logs from which a deviation from log to log is itself not well known; judged
_FEWEST = 3
VARIABLES = {
    "V": ("airspeed", 1.0, "m/s"),
    "qbar": ("dynamic pressure", 1.0, "Pa"),
    "alpha": ("angle of attack", 1.0 / DEG_RAD, "deg"),
}
"""Variable of a trend -> words, factor from SI to the shown unit, that unit."""


def pool_answer(flights: PooledFlights) -> list[Line]:
    """Return the sentences, the coefficients first."""
    pooled = flights.pooled
    lines = [Line("lead", sentence(_lead(pooled)))]
    lines += [Line("doubt", sentence(f"doubt: {_conflict(c, pooled)}")) for c in pooled.in_conflict]
    lines += _agreement(pooled)
    lines += _shared(pooled)
    lines += _trend(pooled)
    if pooled.prior is not None:
        lines.append(Line("finding", sentence(_added(pooled))))
    lines += [Line("doubt", sentence(f"doubt: {text}")) for text in flights.doubts]
    lines += [Line("note", sentence(text)) for text in flights.notes]
    return lines


def _lead(pooled: Pooled) -> str:
    what = f"{counted(len(pooled.logs), 'log')}{' and a prior' if pooled.prior is not None else ''}"
    said = [f"{c.name} {number(c.posterior)} ± {number(c.posterior_std, 2)}" for c in pooled.coefficients]
    return f"{counted(len(pooled.coefficients), 'coefficient')} from {what}: {some(said, _MOST)}"


def _conflict(c: PooledCoefficient, pooled: Pooled) -> str:
    assert c.prior is not None
    assert c.prior_std is not None
    assert c.distance is not None
    assert pooled.prior is not None
    return (
        f"data and prior contradict each other in {c.name}: {number(c.value)} ± {number(c.std, 2)} from the logs, "
        f"{number(c.prior)} ± {number(c.prior_std, 2)} from {pooled.prior.source}, {abs(c.distance):.1f} standard "
        f"deviations apart (more than {CRITERIA.conflict:g}); do not use the value between them: check the model of "
        f"the logs (servo, delay, nonlinearity), mass and inertia, or remove the prior of {c.name}"
    )


def _agreement(pooled: Pooled) -> list[Line]:
    if not pooled.dof:
        if len(pooled.logs) < 2:
            return []
        return [Line("finding", sentence("no coefficient is common to two logs: their agreement cannot be tested"))]
    judged = f"χ² = {pooled.chi2:.3g} for {pooled.dof} degrees of freedom, chance {_chance(pooled.chance)}"
    if pooled.agree:
        return [Line("finding", sentence(f"the logs agree within their errors ({judged})"))]
    apart = pooled.disagreement
    assert apart is not None
    wide = [_between(name, std, abs(pooled.coefficient(name).value)) for name, std in apart.between.items()]
    text = f"doubt: the logs disagree by more than their errors ({judged})"
    if wide:
        text += f"; the errors include a standard deviation from log to log of {some(wide, _MOST, ', ')}"
        least = min(pooled.coefficient(name).logs for name in apart.between)
        if least <= _FEW:
            text += f", which {least} logs determine to {100.0 / (2.0 * (least - 1)) ** 0.5:.0f} % only"
    if pooled.factor > 1.0:
        text += f"; all errors are multiplied by {pooled.factor:.2f}"
    lines = [Line("doubt", sentence(f"{text}; without this they would be those in the column of own errors"))]
    if apart.outlying:
        lines.append(
            Line(
                "doubt",
                sentence(
                    f"doubt: {apart.outlying} differs from the others, which agree without it; check it, it was not "
                    "left out"
                ),
            )
        )
    lines.append(Line("finding", sentence(_causes(pooled, apart.causes))))
    return lines


def _shared(pooled: Pooled) -> list[Line]:
    """Say of which coefficients the error is mostly that of a quantity which all logs share."""
    by: dict[str, list[str]] = {}
    for c in pooled.coefficients:
        if c.mostly:
            part = 100.0 * c.shared[c.mostly] ** 2 / c.std**2
            by.setdefault(c.mostly, []).append(f"{c.name} ({part:.0f} %)")
    return [
        Line(
            "finding",
            sentence(
                f"the error of {what}, {100.0 * pooled.scale_uncertainty[what]:.2g} %, causes most of the variance of "
                f"{some(said, _MOST, ', ')}: more flights do not reduce it, a better {_MEASURED[what]} does"
            ),
        )
        for what, said in by.items()
    ]


_MEASURED = {"airspeed": "calibration of the airspeed", "mass": "weighing"} | dict.fromkeys(
    ("Ixx", "Iyy", "Izz", "Ixz"), "measurement of the inertia"
)


def _causes(pooled: Pooled, causes: tuple[Cause, ...]) -> str:
    own = (
        "errors of single logs that are too small (turbulence, a servo that is not described), other flaps or centre "
        "of gravity, or a missing term of the model"
    )
    few = ""
    if not pooled.trend.names and len(pooled.logs) < 3:
        few = "; two logs cannot distinguish a trend with the condition from scatter: fly a third condition"
    if not causes:
        return f"no error of airspeed, mass or inertia explains it; other candidates: {own}{few}"
    said = []
    for cause in causes:
        name, far = max(cause.deviations.items(), key=lambda item: abs(item[1]))
        said.append(f"{cause.what}, {100.0 * cause.size:g} % from log to log (most in {name}: {100.0 * far:+.1f} %)")
    return f"possible explanation: errors of {'; or '.join(said)}; other candidates: {own}{few}"


def _trend(pooled: Pooled) -> list[Line]:
    if not pooled.trend.names:
        return []
    word, factor, unit = VARIABLES[pooled.trend.variable]
    reference = f"{number(pooled.trend.reference * factor)} {unit}"
    said = []
    for name in pooled.trend.names:
        c = pooled.coefficient(name)
        assert c.posterior_slope is not None
        assert c.posterior_slope_std is not None
        said.append(
            f"{name} by {number(c.posterior_slope / factor)} ± {number(c.posterior_slope_std / factor, 2)} per {unit}"
        )
    if min(pooled.coefficient(name).logs for name in pooled.trend.names) <= _FEWEST:
        said[-1] += (
            " (from three logs, which cannot distinguish a trend from errors that are too small: fly a fourth "
            "condition)"
        )
    rest = " Others are constant." if len(pooled.trend.names) < len(pooled.coefficients) else ""
    return [
        Line(
            "finding", (f"{sentence(f'these vary with {word}: {listed(said)}; values are those at {reference}')}{rest}")
        )
    ]


def _added(pooled: Pooled) -> str:
    assert pooled.prior is not None
    known = [c for c in pooled.coefficients if c.added is not None]
    if not known:
        return (
            f"the prior of {pooled.prior.source} contains none of these coefficients: the values are those of the data"
        )
    ordered = sorted(known, key=lambda c: -(c.added or 0.0))
    said = [f"{c.name} {100.0 * (c.added or 0.0):.3g} %" for c in ordered]
    text = f"what the data added to the prior of {pooled.prior.source}, as share of what is known: {', '.join(said)}"
    without = [c.name for c in pooled.coefficients if c.added is None]
    return text + (f"; without a prior: {', '.join(without)}" if without else "")


def _between(name: str, std: float, size: float) -> str:
    """Return a standard deviation from log to log, in percent as well where the value is not near zero."""
    return f"{name} {number(std, 2)} ({f'{100.0 * std / size:.0f} %' if std <= size else 'more than its value'})"


def _chance(p: float) -> str:
    return f"{100.0 * p:.2g} %" if p >= 1e-4 else "below 0.01 %"
