"""Two studies of the designs: predicted errors against the scatter of estimates, and designs against pilots' rules.

Run with ``make design-study``; the tables go to results/design/.
"""

import csv
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from simulated_estimates import estimates

from testbench.core.constants import DEG_RAD
from testbench.core.record import FloatArray
from testbench.core.scenario.inputs import Doublet, Multisine, StandardMultistep, Sweep
from testbench.design.candidates import UNIT_DEG, Candidate, sampled
from testbench.design.limits import Limits, Prediction
from testbench.design.problem import Problem, judge
from testbench.design.refine import Steps, Switching, designed_switching, worst_cost
from testbench.design.search import screen
from testbench.evaluation.modes import elastic_modes, modes_of, roots_of
from testbench.flight import FlightCondition, linearise, load_aircraft, trim
from testbench.information.aircraft_structure import aircraft_structure
from testbench.information.fisher import Experiment, accuracy, cost
from testbench.information.targets import needed_parameters, targets
from testbench.sensors import load_suite

RUNS = 200
CASES = {"taurus": (12.0, 100.0, "taurus_8hz", 5.0), "eolo": (16.0, 547.0, "eolo_alpha", 2.0)}


def best_of_all_signs(form: Switching) -> tuple[FloatArray, float]:
    """Return the best of all signs +1 and -1 (b,), and its cost; for 16 blocks or less it takes seconds."""
    best, found = np.inf, np.zeros(len(form.K))
    for rest in product((1.0, -1.0), repeat=len(form.K) - 1):  # the first sign is free: both are one signal
        s = np.array([1.0, *rest])
        M, moved = form.at(s)
        value = worst_cost([form.problem], [M], [moved])
        if value < best:
            best, found = value, s
    return found, best


def problem(
    name: str,
    duration_s: float,
    shortest_s: float,
    start_s: float = 1.0,
    by_modes: bool = False,
    wings: str = "flexible",
    free: tuple[str, ...] = (),
) -> Problem:
    """Return a design problem at the sensors' own rate, with sensors free of lag and delay, and a peak amplitude.

    No other limit holds: what is compared has the same duration and the same peak.
    """
    V, h, suite_name, peak_deg = CASES[name]
    aircraft, suite = load_aircraft(name, wings), load_suite(suite_name)
    trimmed = trim(aircraft, FlightCondition(V, h))
    linear = linearise(aircraft, trimmed)
    modes = modes_of(linear, aircraft, "longitudinal")
    sensors = tuple(replace(s, lag_s=0.0, delay_s=0.0) for s in suite.sensors if s.channel in suite.outputs)
    free = free or needed_parameters("longitudinal", ("de",), False, ())
    structure = aircraft_structure(
        linear,
        trimmed,
        "longitudinal",
        elastic_modes(aircraft, "longitudinal"),
        ("de_cmd",),
        [s.channel for s in sensors],
        free,
    )
    dt = 1.0 / suite.rate_hz
    samples = round(duration_s / dt)
    wide = Limits(deflection={"de": 10.0}, rate={}, speed_change_m_s=1e6)
    prediction = Prediction(linear, ("de",), wide, {"V": 2e6}, dt, samples)
    # the peak of the command alone binds
    k = prediction.names.index("command of de")
    high, low = np.full(len(prediction.names), 1e9), np.full(len(prediction.names), -1e9)
    high[k], low[k] = peak_deg * DEG_RAD, -peak_deg * DEG_RAD
    object.__setattr__(prediction, "high", high)
    object.__setattr__(prediction, "low", low)
    aimed = roots_of(modes, "short period") if by_modes else {}
    wanted = {} if by_modes else {p: 0.01 for p in free if p != "Z_de"}
    aim = targets(structure, wanted, aimed, (0.01, 0.01))
    wn = [abs(p) for p in roots_of(modes, "short period").values()]
    band = (0.3 * min(wn) / (2 * np.pi), 1.6 * max(wn) / (2 * np.pi))
    return Problem(
        Experiment(structure, sensors, dt, samples), prediction, aim, "worst", ("de",), duration_s, start_s,
        shortest_s, band, False,
    )  # fmt: skip


def amplitude(name: str) -> dict[str, Any]:
    """Return the keywords of a unit input on the elevator."""
    return {"control": "de", "amplitude_deg": UNIT_DEG}


def candidate(p: Problem, family: str, *specs: Any) -> Candidate:
    """Return entries as a candidate of a problem."""
    return Candidate(family, "", specs, sampled(specs, p.controls, p.duration_s, p.rate_hz))


def entries(name: str, start_s: float, duration_s: float) -> Iterator[tuple[str, Any]]:
    """Yield (family, entry) of what is flown by rule: the papers' doublet and 3-2-1-1, a sweep and a multisine."""
    unit = {**amplitude(name), "start_s": start_s}
    left = duration_s - start_s
    top = 1.0 if name == "eolo" else 0.7
    yield "doublet", Doublet(signal="doublet", period_s=2.0, **unit)
    yield "3-2-1-1", StandardMultistep(signal="3211", step_s=0.25, **unit)
    yield "sweep", Sweep(signal="sweep", f_start_hz=0.2, f_end_hz=top, sweep_s=left, **unit)
    yield "multisine", Multisine(signal="multisine", f_min_hz=0.2, f_max_hz=top, period_s=left, **unit)


# --- predicted against found ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Checked:
    """One design: predicted and found relative standard errors of the parameters, and the criterion by both."""

    aircraft: str
    design: str
    predicted: np.ndarray
    found: np.ndarray
    names: tuple[str, ...]

    @property
    def pooled(self) -> float:
        """Root mean square of found over predicted errors: 1 where the prediction is right."""
        return float(np.sqrt(np.mean((self.found / self.predicted) ** 2)))


def check_predictions(name: str, runs: int, seed: int = 1, designs: int = 5) -> list[Checked]:
    """Return the scatter of ``runs`` estimates beside the predicted errors for several inputs of one aircraft."""
    p = problem(name, 20.0 if name == "taurus" else 8.0, 0.5 if name == "taurus" else 0.2)
    k = [i for i, n in enumerate(p.experiment.structure.parameter_names) if n in p.targets.names]
    true = np.abs(p.experiment.structure.true[k])
    inputs = []
    for family, spec in entries(name, p.start_s, p.duration_s):
        one = candidate(p, family, spec)
        inputs.append((family, one.u * judge(p, one).factor))
    inputs.append(("designed switching", designed_switching(p, screen(p))[0].u))
    out = []
    for family, u in inputs[-designs:]:
        predicted = accuracy(p.experiment.information(u)).std[k] / true
        found = np.std(estimates(p.experiment, u, runs, seed)[:, k] - p.experiment.structure.true[k], axis=0) / true
        out.append(Checked(name, family, predicted, found, p.targets.names))
    return out


def misordered(checked: list[Checked], runs: int) -> list[tuple[str, str]]:
    """Return pairs that prediction and scatter order differently although the scatter tells them apart.

    The worst error of ``runs`` estimates scatters by 1 / sqrt(2 runs); three standard errors of a ratio count.
    """
    significant = 3.0 * np.sqrt(2.0) / np.sqrt(2.0 * runs)
    out = []
    for a in checked:
        for b in checked:
            if np.log(b.found.max() / a.found.max()) > significant and a.predicted.max() > b.predicted.max():
                out.append((a.design, b.design))
    return out


# --- against the pilots' rules ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Rule:
    """A designed input beside one flown by rule: same record, same peak; and same time in which the control moves."""

    aircraft: str
    aims: str
    rule: str
    duration_s: float
    rule_error: float
    designed_error: float
    short_error: float

    @property
    def gain(self) -> float:
        """How many times smaller the worst relative standard error of the design is, in the same record."""
        return self.rule_error / self.designed_error

    @property
    def short_gain(self) -> float:
        """The same where the design may move the control no longer than the rule does (best of all signs)."""
        return self.rule_error / self.short_error


def against_rules(name: str, by_modes: bool) -> list[Rule]:
    """Return the designs for the short period of one aircraft against the papers' doublet and 3-2-1-1."""
    duration = 8.0 if name == "taurus" else 10.0
    shortest = 0.25 if name == "taurus" else 0.1
    p = problem(name, duration, shortest, by_modes=by_modes)
    designed = designed_switching(p, screen(p))[0]
    out = []
    for family, spec in list(entries(name, p.start_s, p.duration_s))[:2]:
        rule = judge(p, candidate(p, family, spec))
        moves = 2.0 if family == "doublet" else 1.75
        step = max(round(moves * p.rate_hz / 14), 1)
        start, count = round(p.start_s * p.rate_hz), int(moves * p.rate_hz) // step
        form = Switching.of(p, Steps(step, start, count))
        _, short = best_of_all_signs(form)
        aims = "wn and zeta of the short period" if by_modes else "derivatives of the short period"
        out.append(Rule(name, aims, family, duration, 0.01 * rule.cost, 0.01 * designed.cost, 0.01 * short))
    return out


# --- tables -----------------------------------------------------------------------------------------------------------


def write_tables(folder: Path, runs: int = RUNS) -> list[Path]:
    """Run both studies and write prediction.csv and against_the_rules.csv."""
    folder.mkdir(parents=True, exist_ok=True)
    out = []
    checked = [c for name in CASES for c in check_predictions(name, runs)]
    path = folder / "prediction.csv"
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["aircraft", "design", "parameter", "predicted [%]", f"found in {runs} estimates [%]", "ratio"])
        for c in checked:
            for n, a, b in zip(c.names, c.predicted, c.found, strict=True):
                writer.writerow([c.aircraft, c.design, n, f"{100 * a:.4g}", f"{100 * b:.4g}", f"{b / a:.3f}"])
    out.append(path)
    path = folder / "against_the_rules.csv"
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(
            ["aircraft", "targets", "rule", "record [s]", "worst error by rule [%]", "designed, same record [%]",
             "gain", "designed, moving no longer [%]", "gain moving no longer"]
        )  # fmt: skip
        for name in CASES:
            for by_modes in (False, True):
                for r in against_rules(name, by_modes):
                    errors = (f"{100 * r.rule_error:.4g}", f"{100 * r.designed_error:.4g}", f"{r.gain:.2f}")
                    writer.writerow(
                        [r.aircraft, r.aims, r.rule, r.duration_s, *errors, f"{100 * r.short_error:.4g}",
                         f"{r.short_gain:.2f}"]
                    )  # fmt: skip
    out.append(path)
    return out


__all__ = ["CASES", "RUNS", "against_rules", "check_predictions", "cost", "misordered", "problem", "write_tables"]
