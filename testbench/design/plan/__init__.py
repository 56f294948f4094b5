"""Flight plans: a build-up of points, cards flown in the simulator beforehand, repeats, times and energy."""

from testbench.design.plan.planning import load_plan, make_plan, plan_faults
from testbench.design.plan.types import Card, FlightLeg, Plan, Point, Reached, Run

__all__ = ["Card", "FlightLeg", "Plan", "Point", "Reached", "Run", "load_plan", "make_plan", "plan_faults"]
