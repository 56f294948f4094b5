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

TRANSFER_FUNCTIONS = {
    "theta": ("equation 6", (1.091,), (1.0, 1.079, 3.192, 1.731, 1.772)),
    "q": ("equation 7", (7.88, -11.34, -2.67, 3.701), (1.0, 1.031, 4.341, 3.027, 1.624)),
    "u": ("equation 8", (-7.236, 13.9, 0.3086, -9.785), (1.0, 0.4466, 4.586, 0.03268, 0.3302)),
    "h": ("equation 9", (61.68,), (1.0, 0.8699, 2.112, 1.442, 0.2138)),
}
"""Taurus paper: output per elevator -> (where, numerator, denominator) in falling powers of s."""

RUNS, LONGITUDINAL, LATERAL = 63, 37, 26
DOUBLET_S, LOG_HZ, SHARE_PERCENT = 2.0, 8.0, (70, 30)  # taurus paper, sections IV, V and VII

TAURUS_TABLE_1_IN = {"wing area": 435.0, "span": 50.0, "chord": 11.0}
TAURUS_TAIL_IN = {"span": 7.0, "area": 89.0, "chord": 2.0, "aspect ratio": 1.23, "elevator chord": 4.0}
TAURUS_ASPECT_RATIO, ELEVATOR_DEG, RUDDER_DEG = 6.7, 12.5, 25.0
"""Taurus paper, Table I, in inches, square inches and degrees."""

EOLO_TABLE_1 = {"S": 0.846, "c": 0.2311, "b": 4.0, "mass": 8.87, "Ixx": 2.53, "Iyy": 1.60, "Izz": 3.96}
EOLO_ASPECT_RATIO = 18.91
STATED_INPUTS = 2  # EOLO paper, section 3.2: "two system inputs, and three measured outputs"
EOLO_TABLE_2 = {
    "1st symmetric wing bending": (4.6, 1.6),
    "Tail-boom torsion": (7.7, 2.1),
    "1st asymmetric wing bending + tail-boom torsion, first": (10.6, 2.2),
    "1st asymmetric wing bending + tail-boom torsion, second": (11.6, 1.2),
    "1st symmetric wing torsion + tail-boom bending": (15.0, 1.7),
    "1st asymmetric wing torsion": (19.1, 3.2),
    "2nd symmetric wing bending + symmetric wing torsion": (21.2, 3.8),
    "2nd asymmetric wing bending": (30.4, 2.4),
}
"""EOLO paper, Tables 1 (SI) and 2 (Hz, percent of critical damping, from the ground vibration test)."""

RATE_HZ, IDENTIFICATION, VALIDATION, WINDOW_S = 100.0, 1251, 1250, (1300.0, 1325.0)
EOLO_PAST, EOLO_FUTURE, B1_PAST, B1_FUTURE, ORDERS = 200, 4, 90, 3, (4, 5)
SPEEDS_M_S, HEIGHT_M, VIBRATION_M_S, BAND_RAD_S = (13.0, 16.0, 19.0, 22.0, 25.0), 547.0, 20.0, 10.0
"""EOLO paper, section 3.2, the captions of Tables 3 and 4."""

A = np.array(
    [
        [1.0004, 0.0196, -0.0007, -0.0476],
        [-0.0009, 0.9975, -0.0090, 0.0203],
        [0.0002, -0.0119, 0.9602, -0.0061],
        [-0.0088, 0.0565, 0.3882, -0.4514],
    ]
)
B = np.array([[-0.0110], [-0.0250], [-0.0590], [0.5828]])
C = np.array([[-0.2367, 0.7813, 2.1534, 0.0551], [-9.7155, 0.1266, -0.2521, 0.1903], [0.3800, 2.2511, -0.7313, 0.0257]])
D = np.array([[-0.0282], [-0.6955], [-0.0074]])
K = np.array(
    [[18.9035, 1.3392, 0.8768], [-2.9461, -0.1493, -2.6047], [1.2696, 0.1068, -2.6047], [2.1353, -0.2380, 44.1748]]
)
MATRICES = {"A": A, "B": B, "C": C, "D": D, "K": K}
"""EOLO paper, section 3.2: the identified model of order 4 at 100 Hz, outputs q, V, theta."""

STATED_PAIR, STATED_Z3, STATED_Z4 = complex(1.0001, 0.0047), -0.1354, 0.9567
"""EOLO paper, section 3.2: the eigenvalues of A as the text states them."""

TABLE_3 = {
    4: {"q": (27.35, 63.82), "V": (31.06, 100.0), "theta": (23.95, 100.0), "mean": (27.46, 87.94)},
    5: {"q": (27.53, 63.33), "V": (31.08, 100.0), "theta": (23.87, 100.0), "mean": (27.50, 87.77)},
}
"""EOLO paper: order -> output -> MRSE in percent on the identification and the validation set."""

TABLE_4 = {
    "without": {"q": 80.28, "V": 74.11, "theta": 63.67, "mean": 72.69},
    "with": {"q": 1.01, "V": 11.62, "alpha": 0.96, "theta": 5.38, "mean": 4.74},
}
"""EOLO paper: MRSE in percent on the identification set, n = 4, J = 90, L = 3, without and with alpha."""


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


# --- what the papers print --------------------------------------------------------------------------------------------


def shown(value: float) -> str:
    """Return a printed value without trailing zeros and with a true minus."""
    return f"{value:.6g}".replace("-", "−")


def polynomial(coefficients: tuple[float, ...]) -> str:
    """Return "s⁴ + 1.079 s³ + …" of coefficients in falling powers of s."""
    powers = "⁰¹²³⁴"
    out = ""
    for value, power in zip(coefficients, range(len(coefficients) - 1, -1, -1), strict=True):
        unit = "" if power == 0 else "s" if power == 1 else f"s{powers[power]}"
        size = "" if abs(value) == 1.0 and unit else shown(abs(value))
        term = f"{size} {unit}".strip()
        sign = "−" if value < 0.0 else "+"
        out += f" {sign} {term}" if out else ("−" if value < 0.0 else "") + term
    return out
