"""The only room that knows JSBSim: trim, simulate, linearise."""

from testbench.flight.condition import FlightCondition, Start, TrimmedFlight
from testbench.flight.linear_model import LinearModel
from testbench.flight.linearise import linearise, linearise_along
from testbench.flight.load import load_aircraft
from testbench.flight.simulate import Manoeuvre, fly
from testbench.flight.trim import trim

__all__ = [
    "FlightCondition",
    "LinearModel",
    "Manoeuvre",
    "Start",
    "TrimmedFlight",
    "fly",
    "linearise",
    "linearise_along",
    "load_aircraft",
    "trim",
]
