"""Flights, measurements and estimates for the sections: one aircraft at one trim, many inputs and seeds."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from testbench.aircraft import Aircraft
from testbench.aircraft.amend import Amendment
from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.scenario.inputs import Input
from testbench.estimators import estimate
from testbench.estimators.identification import Estimator
from testbench.estimators.model import IdentifiedModel
from testbench.estimators.settings import DsrE, Subspace
from testbench.estimators.state_space import StateSpaceModel
from testbench.evaluation.metrics import mrse_percent
from testbench.evaluation.truth import Truth, true_model
from testbench.flight import TrimmedFlight, load_aircraft
from testbench.flight.air import Air, turbulence_rms
from testbench.flight.batch.jobs import Job
from testbench.flight.simulate import Manoeuvre
from testbench.line import fly_and_measure, trim_for
from testbench.questions.run.scenario import Scenario


@dataclass(frozen=True, eq=False)
class Bench:
    """The aircraft of a scenario at its trim, changed by amendments or not."""

    scenario: Scenario
    aircraft: Aircraft
    trimmed: TrimmedFlight

    @cached_property
    def truth(self) -> Truth:
        """Linear model and modes."""
        return true_model(self.aircraft, self.trimmed)

    def fly(
        self,
        inputs: Iterable[Input],
        duration_s: float,
        log_hz: float = 100.0,
        settle_s: float = 2.0,
        turbulence_m_s: float = 0.0,
        seed: int = 0,
        name: str = "run",
    ) -> FlightRecord:
        """Return the truth of one flight; turbulence by its vertical rms, in the scenario's height above ground."""
        air = None
        if turbulence_m_s:
            rms = turbulence_rms(turbulence_m_s, self.scenario.condition.h_m)
            air = Air(0.0, 0.0, 0.0, rms, None, None, seed)
        manoeuvre = Manoeuvre.of(name, tuple(inputs), duration_s, self.trimmed.rate_hz, settle_s)
        return fly_and_measure(Job(self.aircraft, self.trimmed, manoeuvre, log_hz, air=air)).flown


def bench(name: str, *amendments: Amendment) -> Bench:
    """Return the bench of the packaged scenario ``name``."""
    scenario = Scenario.load(name)
    aircraft = load_aircraft(scenario.aircraft, scenario.wings)
    aircraft = aircraft.amended(*amendments) if amendments else aircraft
    return Bench(scenario, aircraft, trim_for(scenario, aircraft))


def dsr_e(order: int, past: int, future: int, direct: bool = False, closed_loop: bool = False) -> DsrE:
    """Return the entry of a scenario for DSR_e."""
    return DsrE(
        method="dsr_e",
        order=order,
        past_horizon=past,
        future_horizon=future,
        direct_feedthrough=direct,
        closed_loop=closed_loop,
    )


def subspace(
    method: str, order: int, past: int, future: int, direct: bool = False, closed_loop: bool = False
) -> Subspace:
    """Return the entry of a scenario for another subspace method, at the rate of the record."""
    return Subspace(
        method=method,  # type: ignore[arg-type]
        order=order,
        past_horizon=past,
        future_horizon=future,
        decimate=1,
        direct_feedthrough=direct,
        closed_loop=closed_loop,
    )


def attempt(
    spec: Estimator, records: Sequence[FlightRecord], inputs: Sequence[str], outputs: Sequence[str]
) -> IdentifiedModel | None:
    """Return the estimate, or None where the estimator refuses the data or the settings."""
    try:
        return estimate(spec, records, inputs, outputs)
    except EstimationError:
        return None


def lost_poles(model: IdentifiedModel) -> int:
    """Return how many discrete poles have no continuous counterpart (real z <= 0)."""
    return len(model.diagnostics.get("poles_without_continuous_counterpart", ()))


def from_rest(model: StateSpaceModel, record: FlightRecord) -> FloatArray:
    """Return the outputs (N, p) from a zero initial state, driven by the record's inputs."""
    x, out = np.zeros(model.order), np.empty((len(record), len(model.outputs)))
    for k, u in enumerate(record.columns(model.inputs)):
        out[k] = model.C @ x + model.D @ u
        x = model.A @ x + model.B @ u
    return out


def scores(model: IdentifiedModel, record: FlightRecord, predicted: FloatArray | None = None) -> dict[str, float]:
    """Return output -> MRSE in percent on a record; without an initial state, that of a free run with a fitted one."""
    yhat = model.simulate(record) if predicted is None else predicted
    found = mrse_percent(record.columns(model.outputs), yhat)
    return dict(zip(model.outputs, found.tolist(), strict=True))
