"""What earlier flights told of the parameters of a design: the next input is designed for what is still uncertain.

With P_i the covariance of the estimates x_i of flight i, their information and what they say together are

    M = sum P_i^-1,    x = M^-1 sum P_i^-1 x_i.

The next input is judged by M + its own information, at an aircraft whose derivatives are x. What flights hardly know
must not make an odd aircraft: for the values alone, the model counts as known to half of each derivative.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2

from testbench.aircraft import Aircraft
from testbench.core.door import read_json
from testbench.core.errors import EstimationError, RecordError, Refusal
from testbench.core.files import parsed
from testbench.core.record import FloatArray
from testbench.core.store import settle
from testbench.design.ensemble import Member
from testbench.design.identified import STRUCTURE
from testbench.design.problem import Problem
from testbench.estimators.structured import per_speed
from testbench.flight import TrimmedFlight
from testbench.information.aircraft_structure import AircraftStructure
from testbench.information.fisher import accuracy
from testbench.page.words import listed
from testbench.pooling.prior import Prior
from testbench.questions.design.pose import pose
from testbench.questions.design.ready import promise_of_file
from testbench.questions.design.scenario import DesignScenario
from testbench.questions.identify.amend.choose import REACHED_BY, coefficient_errors, reached
from testbench.sensors import SensorSuite

MODEL = 0.5
"""Relative standard deviation that a derivative of the model counts with where flights say another; judged."""
DISAGREE = 0.01
"""Probability below which flights that differ by chance are said to disagree."""
_SAME_SPEED = 0.05
"""Relative difference of airspeed up to which derivatives are taken as the same; judged: 10 % of a moment."""
_GROWN = 1.1  # of a stated error, from which its growth is named
_PACKAGED = ("longitudinal", "short_period", "lateral_directional", "lateral_per_speed")
_AS_HELD = "flexible"  # names the derivatives with elastic modes held, forces per mass: those of a design


@dataclass(frozen=True, eq=False)
class Known:
    """What is known of a design before its flight."""

    prior: Prior  #: what the flights say together, of parameters that the design has
    errors: FloatArray  #: (t,) standard errors of the targets by the flights alone; inf where they do not tell
    before: FloatArray  #: (t,) values of the targets that the model had
    notes: tuple[str, ...] = ()  #: in sentences


class AllKnown(EstimationError):
    """Every target of a design is known as well as wanted: there is nothing to design.

    Attributes:
        problem: the design problem.
        known: what is known.
    """

    def __init__(self, problem: Problem, known: Known) -> None:
        self.problem, self.known = problem, known
        names = listed(list(problem.targets.names))
        super().__init__(
            "a design needs a target that is not known as well as wanted, but the wanted accuracy is reached by "
            f"{known.prior.source} for {names}; no flight is needed for them, or want smaller errors"
        )


def known_after(found: Sequence[Path | str], V_m_s: float) -> Prior:
    """Return what identified flights say of the derivatives of an aircraft, all together.

    Args:
        found: model files (``models/*.json``), or folders with such files: what `testbench plan close`, `testbench
            identify` and `testbench run` write. Every one is a flight of its own.
        V_m_s: airspeed at which the derivatives are to hold.

    Returns:
        Derivatives in SI units and rad, forces per mass, with their covariance.

    Raises:
        RecordError: a path holds no model with parameters.
        EstimationError: a model's parameters are not derivatives, or of a flight at another speed.

    Example:
        >>> import json, tempfile
        >>> from pathlib import Path
        >>> import testbench as tb
        >>> model = {"structure": "designed_for", "covariance": [[0.04]],
        ...          "parameters": {"M_q": {"value": -2.0, "free": True}}}
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     files = [Path(folder) / name for name in ("first.json", "second.json")]
        ...     for file in files:
        ...         length = file.write_text(json.dumps(model))
        ...     known = tb.known_after(files, V_m_s=16.0)
        >>> known.names, round(float(known.covariance[0, 0]), 6)
        (('M_q',), 0.02)
    """
    files = [file for path in found for file in _files(Path(path))]
    parts = [_read(file, V_m_s) for file in files]
    return together([p for p in parts if p.names])


def together(parts: Sequence[Prior]) -> Prior:
    """Return what several flights say together; where they differ by more than chance, their errors grow.

    Raises:
        EstimationError: there are none.
    """
    if not parts:
        raise EstimationError("the previous flights must determine some derivative of the design, got none")
    names = tuple(dict.fromkeys(n for p in parts for n in p.names))
    M, y = np.zeros((len(names), len(names))), np.zeros(len(names))
    for p in parts:
        at = [names.index(n) for n in p.names]
        own = np.linalg.inv(p.covariance)
        M[np.ix_(at, at)] += own
        y[at] += own @ p.values
    P = np.linalg.inv(M)
    x = P @ y
    square, dof = 0.0, -len(names)
    for p in parts:
        off = p.values - x[[names.index(n) for n in p.names]]
        square += float(off @ np.linalg.solve(p.covariance, off))
        dof += len(p.names)
    notes = list(dict.fromkeys(n for p in parts for n in p.notes))
    if dof > 0 and chi2.sf(square, dof) < DISAGREE:
        ratio = square / dof
        P = P * ratio
        notes.append(
            f"the flights differ by {ratio**0.5:.2g} times more than their errors (air, trim or speed differed): their "
            "errors are multiplied by that factor"
        )
    return Prior(names, x, 0.5 * (P + P.T), listed(list(dict.fromkeys(p.source for p in parts))), tuple(notes))


def _files(path: Path) -> list[Path]:
    if not settle(path).is_dir():
        return [path]
    folder = path / "models" if (path / "models").is_dir() else path
    files = sorted(folder.glob("*.json"))
    if not files:
        raise RecordError(
            "previous flights must be a model or a folder with models/*.json, as testbench plan close, identify and "
            f"run write them, got '{path}' without one"
        )
    return files


def _read(file: Path, V_m_s: float) -> Prior:
    """Return what one model file says.

    Raises:
        RecordError: it holds no model with parameters and their covariance.
        EstimationError: the parameters are not derivatives, or of another speed.
    """
    with parsed(file, "a model with parameters (models/*.json)"):
        content: dict[str, Any] = read_json(file, "model")
        structure = str(content["structure"])
        parameters: dict[str, Any] = content["parameters"]
        values = np.array([float(p["value"]) for p in parameters.values()])
        P = np.array(content["covariance"], float).reshape(len(parameters), len(parameters))
        free = [bool(p["free"]) for p in parameters.values()]
        condition, status = content.get("condition"), str(content.get("status", "good"))
        flown = None if condition is None else float(condition["V_m_s"])
        errors = {str(name): float(e) for name, e in content.get("flown_errors", {}).items()}
        promise = Path(str(content["promise"])) if "promise" in content else None
    if structure != STRUCTURE and structure not in _PACKAGED:
        raise EstimationError(
            "previous flights must be identified by the estimator of a design, or by one of the structures "
            f"{', '.join(_PACKAGED)}, so that its parameters are derivatives, got '{file}' with {structure}"
        )
    if flown is not None and abs(flown / V_m_s - 1.0) > _SAME_SPEED:
        raise EstimationError(
            f"previous flights must be at the speed of the design, {V_m_s:g} m/s, got {flown:.4g} m/s in '{file}': "
            "derivatives change with it; leave it out"
        )
    keep = [i for i, (p, s) in enumerate(zip(free, np.diag(P), strict=True)) if p and s > 0.0]
    names = [name for i, name in enumerate(parameters) if i in keep]
    per = np.array([V_m_s if per_speed(structure, n.partition("_")[0]) else 1.0 for n in names])
    scaled, notes = values[keep] * per, []
    if flown is None:
        notes.append(f"{file.name} does not state its airspeed: that of the design is used")
    if status == "wrong":
        notes.append(
            f"the estimator has doubts about its model {file.name}: its derivatives and their errors may be wrong"
        )
    if structure != STRUCTURE:
        notes.append(
            f"{file.name} is of the structure {structure}: its errors assume that its fixed parameters are known"
        )
    stated = np.sqrt(np.diag(P)[keep])
    if not errors:
        errors, why = _beyond_stated(dict(zip(names, stated.tolist(), strict=True)), promise)
        notes.append(f"{file.name}: {why}")
    per = per * np.array([max(errors.get(n, 0.0) / s, 1.0) for n, s in zip(names, stated, strict=True)])
    covariance = P[np.ix_(keep, keep)] * np.outer(per, per)
    return Prior(tuple(names), scaled, 0.5 * (covariance + covariance.T), str(file), tuple(notes))


def _beyond_stated(stated: Mapping[str, float], promise: Path | None) -> tuple[dict[str, float], str]:
    """Return the errors that count where the estimator states some, and what they are, in words.

    What a model leaves out moves its estimates by what no estimator can state: a wing that bends is off by the same in
    every flight. The simulated flights of the design show it. With their mean error m, and k what they scatter beyond
    their stated errors, the error is sqrt((s k)^2 + m^2), as of `testbench plan close`.

    Args:
        stated: parameter -> standard error s that the estimator states.
        promise: file of what was promised of the design that was flown; None if the model names none.
    """
    alone = "its errors are those of its estimator alone, without the influence of what its equations omit"
    if promise is None:
        return {}, alone
    if not promise.is_file():
        return {}, f"{alone}: '{promise}', which says what simulated flights of the design had, is not there any more"
    said = promise_of_file(promise)
    if said.realised is None or said.realised.found.n < 1:
        return {}, f"{alone}: the design was not flown in simulation"
    found, at = said.realised.found, {name: k for k, name in enumerate(said.names) if name in stated}
    errors = {n: float(np.hypot(stated[n] * found.excess(k), found.lasting(k))) for n, k in at.items()}
    grown = [f"{n} by {e / stated[n]:.2g}" for n, e in errors.items() if e > _GROWN * stated[n]]
    head = f"its errors hold what {found.n} simulated flights of the design had beyond stated ones"
    return errors, f"{head}: {listed(grown)}" if grown else f"{head}, which is negligible"


def of_problem(prior: Prior, problem: Problem) -> tuple[Prior, FloatArray]:
    """Return the part of a prior that a design has as parameters, and its information (k, k) in their order.

    Raises:
        EstimationError: the prior tells none of them.
    """
    structure = problem.experiment.structure
    own = structure.parameter_names
    shared = [n for n in own if n in prior.names]
    if not shared:
        raise EstimationError(
            f"previous flights must determine parameters of this design ({', '.join(own)}), but {prior.source} "
            f"determine {', '.join(prior.names)}"
        )
    part, M = prior.of(shared), np.zeros((len(own), len(own)))
    at = [own.index(n) for n in shared]
    M[np.ix_(at, at)] = np.linalg.inv(part.covariance)
    left = [n for n in prior.names if n not in own]
    lost = [n for n in own if n not in shared]
    notes = [*part.notes]
    if left:
        notes.append(f"of the previous flights {listed(left)} {'is' if len(left) == 1 else 'are'} not used")
    if lost:
        notes.append(f"the previous flights give no information on {listed(lost)}")
    return replace(part, notes=tuple(notes)), 0.5 * (M + M.T)


def believe(scenario: DesignScenario, believed: Member, suite: SensorSuite, flown: Prior) -> tuple[Member, Known]:
    """Return the design problem at the values that earlier flights gave, with their information, and what is known.

    Raises:
        AllKnown: every target is known as well as wanted.
    """
    part, M = of_problem(flown, believed.problem)
    before = believed.problem.targets
    aircraft, notes = with_values(believed.aircraft, believed.trimmed, believed.problem.experiment.structure, part)
    now = pose(scenario, aircraft, suite)
    names = now.problem.targets.names
    if names == before.names:  # a mode may split, or join: wanted errors stay those of the scenario where they can
        values = before.values
    else:
        had = dict(zip(before.names, before.values.tolist(), strict=True))
        values = np.array([had.get(n, np.nan) for n in names])
    problem = replace(now.problem, known=M)
    known = Known(part, problem.targets.errors(accuracy(M)), values, (*part.notes, *notes))
    if np.all(known.errors <= problem.targets.wanted):
        raise AllKnown(problem, known)
    return replace(now, problem=problem), known


def with_values(
    aircraft: Aircraft, trimmed: TrimmedFlight, structure: AircraftStructure, prior: Prior
) -> tuple[Aircraft, tuple[str, ...]]:
    """Return the aircraft whose linearised model has the derivatives that are now believed, and notes.

    Args:
        aircraft: as believed before.
        trimmed: at the condition of the design.
        structure: the linearised aircraft with the parameters of the design.
        prior: of its parameters.
    """
    model = dict(zip(structure.parameter_names, structure.true.tolist(), strict=True))
    names = [n for n in prior.names if tuple(n.split("_", 1)) in REACHED_BY]
    stay = [n for n in prior.names if n not in names]
    notes = [f"{listed(stay)} stay as the model has them: no coefficient gives them"] if stay else []
    if not names:
        return aircraft, tuple(notes)
    part = prior.of(names)
    own = np.array([model[n] for n in names])
    wide = np.where(own != 0.0, MODEL * np.abs(own), 1e3 * np.sqrt(np.diag(part.covariance)))
    gain = part.covariance @ np.linalg.inv(part.covariance + np.diag(wide**2))
    aims = dict(zip(names, (part.values + gain @ (own - part.values)).tolist(), strict=True))
    new, _ = reached(aircraft, trimmed.condition, _AS_HELD, aims)
    errors = coefficient_errors(new, trimmed.condition, _AS_HELD)
    stated = dict(new.uncertainty)
    for name, std in zip(names, np.sqrt(np.diag(part.covariance)).tolist(), strict=True):
        key = REACHED_BY[name[0], name[2:]]
        if key in stated:
            try:
                value = abs(new.coefficient(key))
            except Refusal:
                continue
            if value > 0.0:
                stated[key] = max(min(stated[key], std * errors[name] / value), 1e-6)
    return replace(new, uncertainty=stated), tuple(notes)
