"""The only room that knows JSBSim: trim, simulate, linearise."""

from testbench.flight.condition import FlightCondition, TrimmedFlight
from testbench.flight.linearise import LinearModel, linearise, linearise_along
from testbench.flight.simulate import Manoeuvre, fly
from testbench.flight.trim import trim

__all__ = [
    "FlightCondition",
    "LinearModel",
    "Manoeuvre",
    "TrimmedFlight",
    "fly",
    "linearise",
    "linearise_along",
    "trim",
]
