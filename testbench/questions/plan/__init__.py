"""How is a flight campaign flown: which points in which order, with which cards, repeats, times and energy?

Every card is flown in the simulator first. The results are cards to print, signals and scripts for the autopilot.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, make_plan="ask", PlanScenario="scenario", Plan="result", plan_page="page")
