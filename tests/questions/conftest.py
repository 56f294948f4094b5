"""A small result made by hand: a known linear aircraft, two suites, models whose figures can be worked out on paper."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from testbench.core.record import FlightRecord
from testbench.estimators.model import IdentifiedModel
from testbench.evaluation import TrueSystem, evaluate
from testbench.evaluation.excitation import ModeExcitation
from testbench.evaluation.truth import Truth
from testbench.flight import FlightCondition, LinearModel, TrimmedFlight, load_aircraft
from testbench.line import Case, Flight
from testbench.page.html import first_screen
from testbench.page.page import Page
from testbench.page.words import MOST_WORDS
from testbench.questions.run.result import RunResult
from testbench.questions.run.scenario import Scenario
from testbench.sensors import load_suite

DT = 0.05
MODES = {"phugoid": -0.02 + 0.5j, "short period": -2.0 + 4.0j, "1st symmetric wing bending": -1.0 + 26.0j}
GAINS = {"q": -2.0, "theta": -0.5, "alpha": 0.8}  # of every response in this world: y = gain * u


@dataclass(frozen=True, eq=False, kw_only=True)
class GainModel(IdentifiedModel):
    """y = gain * u, with poles that are simply claimed."""

    gains: tuple[float, ...]
    claimed: Mapping[str, Any] = field(default_factory=dict)
    polynomials: Mapping[str, Any] = field(default_factory=dict)

    def simulate(self, record: FlightRecord) -> np.ndarray:
        return record.columns(self.inputs)[:, [0]] * np.array(self.gains)

    def poles(self) -> dict[str, np.ndarray]:
        return {key: np.asarray(poles, complex) for key, poles in self.claimed.items()}

    def frequency_response(self, omega_rad_s: np.ndarray) -> np.ndarray:
        return np.tile(np.array(self.gains, complex)[:, None], (len(omega_rad_s), 1, 1))

    def to_dict(self) -> dict[str, Any]:
        return {"method": self.method, "inputs": list(self.inputs), "outputs": list(self.outputs), **self.polynomials}

    def to_control(self) -> Any:
        return None


def scenario(folder: Path) -> Scenario:
    """Return a scenario with a file of its own."""
    file = folder / "small.toml"
    file.write_text('title = "Small <world> & co"\n# a comment that must survive\n', encoding="utf-8")
    content = {
        "title": "Small <world> & co",
        "question": "Is q < 1?",
        "aircraft": "eolo",
        "condition": {"V_m_s": 16.0, "h_m": 547.0},
        "manoeuvre": [
            {
                "name": name,
                "use": use,
                "duration_s": 10.0,
                "input": [{"signal": "doublet", "control": "de", "amplitude_deg": 2.0, "period_s": period}],
            }
            for name, use, period in (("slow", "identification", 2.0), ("fast", "validation", 1.0))
        ],
        "suites": ["eolo_no_alpha", "eolo_alpha"],
        "identification": {
            "inputs": ["de"],
            "estimators": [{"method": "dsr_e", "past_horizon": 4, "future_horizon": 4}],
        },
    }
    return Scenario.model_validate(content).at(file)


def flight(name: str, use: str, period_s: float) -> Flight:
    """Return a doublet of 2 deg after 2 s, the truth, and noise-free records of two suites."""
    t = np.arange(0.0, 12.0, DT)
    u = np.deg2rad(2.0) * (
        ((t >= 2.0) & (t < 2.0 + period_s / 2)) * 1.0 - ((t >= 2.0 + period_s / 2) & (t < 2.0 + period_s))
    )
    channels = ("de", *GAINS)
    data = np.column_stack([u, *(g * u for g in GAINS.values())])
    truth = FlightRecord(t, channels, data, "truth", provenance={"aircraft": "eolo", "jsbsim": "1.0"})
    measured = {
        suite: replace(truth.select(names), kind="measured")
        for suite, names in (("eolo_no_alpha", ("de", "q", "theta")), ("eolo_alpha", channels))
    }
    return Flight(name, use, truth, measured, 2.0)


def linear_truth() -> LinearModel:
    """Return a model of the right states whose outputs are gains of de alone."""
    states = ("u", "w", "q", "theta", "h", *(f"{k}_{i}" for k in ("eta", "etadot") for i in range(1, 9)))
    n = len(states)
    return LinearModel(
        -np.eye(n),
        np.zeros((n, 1)),
        np.zeros((3, n)),
        np.array([[g] for g in GAINS.values()]),
        states,
        ("de",),
        tuple(GAINS),
    )


def truth() -> Truth:
    """Return what is known of the small world."""
    condition = FlightCondition(16.0, 547.0)
    trimmed = TrimmedFlight(condition, 500.0, 0.05, 0.05, 0.0, {"de": -0.02, "thr": 0.4}, np.full(6, 1e-12), {})
    excited = tuple(
        ModeExcitation(n, p, (0.9 * abs(p), 1.1 * abs(p)), 0.1, {"q": 30.0 - abs(p), "theta": 5.0})
        for n, p in MODES.items()
    )
    return Truth(load_aircraft("eolo"), trimmed, linear_truth(), MODES, excited)


def case(suite: str, outputs: tuple[str, ...], flights: tuple[Flight, ...], error: float, **kwargs: Any) -> Case:
    """Return a case whose model errs by the factor 1 + ``error`` in every output, so that every MRSE is 100 |error|."""
    model = GainModel(
        method="dsr_e",
        inputs=("de",),
        outputs=outputs,
        dt_s=DT,
        settings={"order": 2},
        diagnostics={"singular_values": np.array([90.0, 20.0, 1.1, 0.9, 0.8]), "order": 2},
        gains=tuple((1.0 + error) * GAINS[o] for o in outputs),
        **{"claimed": {", ".join(outputs): [-2.0 + 4.2j, -2.0 - 4.2j, -0.3]}, **kwargs},
    )
    fit, judge = ([f.measured[suite] for f in flights if f.use == use] for use in ("identification", "validation"))
    omega = np.array([0.5, 1.0, 2.0])
    true = np.tile(np.array([[GAINS[o]] for o in outputs], complex), (3, 1, 1))
    scores = evaluate(model, fit, judge, TrueSystem(MODES, true, omega))
    return Case(suite, scenario_estimator(), tuple(fit), tuple(judge), model, scores)


def scenario_estimator() -> Any:
    from testbench.estimators.settings import DsrE

    return DsrE(method="dsr_e", past_horizon=4, future_horizon=4)


@pytest.fixture(scope="session")
def make_result(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., RunResult]:
    """Return a function that builds the small result; ``changes`` replace its fields."""
    source = scenario(tmp_path_factory.mktemp("scenario"))

    def make(**changes: Any) -> RunResult:
        flights = (flight("slow", "identification", 2.0), flight("fast", "validation", 1.0))
        result = RunResult(
            name="small",
            title=source.title,
            question=source.question,
            source=source,
            seed=3,
            flights=flights,
            cases=(
                case("eolo_no_alpha", ("q", "theta"), flights, 0.25),
                case("eolo_alpha", ("alpha", "q", "theta"), flights, -0.1, advice=("doubt this.",)),
            ),
            truth=truth(),
            suites=(load_suite("eolo_no_alpha"), load_suite("eolo_alpha")),
        )
        return replace(result, **changes)

    return make


@pytest.fixture(scope="session")
def result(make_result: Callable[..., RunResult]) -> RunResult:
    return make_result()


@pytest.fixture(scope="session")
def make_case() -> Callable[..., Case]:
    return case


@pytest.fixture(autouse=True, scope="session")
def short_answers():
    """Refuse every page of a question whose first sentence is longer than can be read at a glance."""
    write = Page.write

    def checked(self, folder):
        for _, text in first_screen(self.answer)[0]:
            words = len(text.split())
            assert words <= MOST_WORDS, f"{self.kicker}: {words} words in '{text}'"
        return write(self, folder)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Page, "write", checked)
        yield
