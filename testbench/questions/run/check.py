"""What can be checked in a scenario before it is flown: the laws of aircraft, inputs and sensors."""

from __future__ import annotations

from collections.abc import Sequence

from testbench.aircraft import Aircraft
from testbench.core.constants import DEG_RAD
from testbench.core.errors import Faults, LimitError, nearest
from testbench.estimators.cells import FailedCell, impossible
from testbench.estimators.identification import estimator_name
from testbench.flight import load_aircraft
from testbench.flight.simulate import require_room_to_fly, stride
from testbench.inputs import build
from testbench.line import log_rate
from testbench.questions.run.labels import failed_sentences
from testbench.questions.run.scenario import Experiment
from testbench.sensors import SensorSuite, load_suite


def check(scenario: Experiment) -> list[str]:
    """Return every law of aircraft, inputs and sensors that the scenario breaks, in words, without flying it."""
    faults = Faults(scenario.file)
    attempt = faults.attempt
    aircraft = attempt("aircraft", load_aircraft, scenario.aircraft, scenario.wings)
    loaded = [attempt(f"suites[{i}]", load_suite, name) for i, name in enumerate(scenario.suites)]
    suites = tuple(s for s in loaded if s is not None)
    if aircraft is None or len(suites) < len(scenario.suites):
        return faults
    rate = scenario.simulation.rate_hz or aircraft.rate_hz
    logged = log_rate(scenario.simulation, suites)
    attempt("simulation.log_rate_hz", stride, rate, logged)
    for i, suite in enumerate(suites):
        attempt(f"suites[{i}]", suite.check_log_rate, logged)
    for i, spec in enumerate(scenario.manoeuvre):
        if attempt(f"manoeuvre[{i}]", build, spec.input, spec.duration_s, rate):
            attempt(f"manoeuvre[{i}]", require_room_to_fly, spec.settle_s + spec.duration_s, rate, logged)
        for k, signal in enumerate(spec.input):
            key = f"manoeuvre[{i}].input[{k}]"
            unit = "amplitude_percent" if signal.control == "thr" else "amplitude_deg"
            attempt(f"{key}.{unit}", check_amplitude, aircraft, signal.control, signal.amplitude)
        if spec.use == "identification" and spec.settle_s == 0.0 and scenario.preparation.bias == "trim":
            attempt(f"manoeuvre[{i}].settle_s", _no_settling)
    for name in (*scenario.identification.inputs, *scenario.identification.outputs):
        if not any(name in s.channels for s in suites):
            attempt("identification", _no_such_sensor, name, suites)
    if not faults:
        attempt("identification.estimators", _none_possible, scenario, suites)
    return faults


def notes(scenario: Experiment) -> list[str]:
    """Return the suites and estimators of a valid scenario that cannot work together; it goes on without them."""
    pairs = impossible_pairs(scenario, [load_suite(name) for name in scenario.suites])
    return [f"the scenario goes on without {text}" for text in failed_sentences(pairs, "")]


def impossible_pairs(scenario: Experiment, suites: Sequence[SensorSuite]) -> list[FailedCell]:
    """Return the suites and estimators that cannot work together, from what methods and structures need."""
    asked, out = scenario.identification, []
    for suite in suites:
        channels = suite.channels
        sensed = asked.outputs or channels
        outputs = tuple(name for name in sensed if name in channels and name not in asked.inputs)
        for entry in asked.estimators:
            reason = impossible(entry, channels, asked.inputs, outputs)
            if reason is not None:
                out.append(FailedCell(suite.name, estimator_name(entry), reason))
    return out


def check_amplitude(aircraft: Aircraft, control: str, amplitude: float) -> None:
    """Check that a control can move so far.

    Raises:
        LimitError: the amplitude is larger than its full deflection.
    """
    if control not in aircraft.controls:
        raise LimitError(f"{aircraft.name} has no control '{control}'{nearest(control, aircraft.controls)}")
    full = max(aircraft.controls[control].full, -aircraft.controls[control].low)
    if abs(amplitude) > full:
        scale, unit = (100.0, "percent") if control == "thr" else (1.0 / DEG_RAD, "deg")
        raise LimitError(
            f"amplitude_{unit} <= {full * scale:g} must hold for control '{control}' of {aircraft.name}, "
            f"got {abs(amplitude) * scale:g}"
        )


def _no_settling() -> None:
    raise LimitError('settle_s > 0 must hold where preparation.bias = "trim" (the bias is read there), got 0')


def _none_possible(scenario: Experiment, suites: Sequence[SensorSuite]) -> None:
    found = impossible_pairs(scenario, suites)
    if found and len(found) == len(suites) * len(scenario.identification.estimators):
        raise LimitError(
            "some estimator must be able to work with some suite, got none: " + "; ".join(failed_sentences(found, ""))
        )


def _no_such_sensor(name: str, suites: Sequence[SensorSuite]) -> None:
    have = ", ".join(dict.fromkeys(c for s in suites for c in s.channels))
    raise LimitError(f"inputs and outputs must be sensed by a suite, got '{name}'; sensed: {have}")
