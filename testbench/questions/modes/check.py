"""What can be said of a scenario of flight in turbulence before it is flown."""

from __future__ import annotations

from testbench.core.errors import Faults, nearest
from testbench.flight import load_aircraft
from testbench.flight.simulate import require_room_to_fly, stride
from testbench.line import log_rate
from testbench.questions.modes.ask import WING, signal_of
from testbench.questions.modes.scenario import ModesScenario, TurbulentFlight
from testbench.sensors import load_suite


def _check_flight(spec: TurbulentFlight, rate_hz: float, log_rate_hz: float) -> None:
    require_room_to_fly(spec.settle_s + spec.duration_s, rate_hz, log_rate_hz)
    signal_of(spec, rate_hz)


def check(scenario: ModesScenario) -> list[str]:
    """Return every law of aircraft, inputs and sensors that the scenario breaks, in words, without flying it."""
    faults = Faults(scenario.file)
    attempt = faults.attempt
    aircraft = attempt("aircraft", load_aircraft, scenario.aircraft, scenario.wings)
    suite = attempt("suite", load_suite, scenario.suite)
    if aircraft is None or suite is None:
        return faults
    rate = scenario.simulation.rate_hz or aircraft.rate_hz
    logged = log_rate(scenario.simulation, [suite])
    attempt("simulation.log_rate_hz", stride, rate, logged)
    attempt("suite", suite.check_log_rate, logged)
    for i, spec in enumerate(scenario.flight):
        attempt(f"flight[{i}]", _check_flight, spec, rate, logged)
    for name in (*scenario.modes.channels, *scenario.modes.references):
        if name not in suite.outputs:
            hint = nearest(name, suite.outputs)
            faults.note("modes", f"channels must be sensed by the suite, got '{name}'{hint}")
    if not scenario.modes.channels and not any(c.startswith(WING) for c in suite.outputs):
        faults.note("modes.channels", f"must be given, suite '{suite.name}' has no sensor on the wing")
    if aircraft.flown_modes() is None:
        faults.note("aircraft", f"{aircraft.name} must have elastic modes, it has none")
    return faults
