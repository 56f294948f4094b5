"""Aircraft folders read into frozen objects, their elastic modes, and changes to them."""

from testbench.aircraft.amend import Amendment, Increment, Insert, Memory, ScaleCoefficient, SetProperty, SetText
from testbench.aircraft.elastic import ElasticMode, ElasticModel
from testbench.aircraft.model import Aircraft, Control, read_aircraft

__all__ = [
    "Aircraft",
    "Amendment",
    "Control",
    "ElasticMode",
    "ElasticModel",
    "Increment",
    "Insert",
    "Memory",
    "ScaleCoefficient",
    "SetProperty",
    "SetText",
    "read_aircraft",
]
