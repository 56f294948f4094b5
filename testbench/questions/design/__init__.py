"""Which input, how large and how long, determines the wanted parameters or modes within the limits?

Every family of signals is screened by spectral energy and information; the best are refined, flown in the simulator,
scaled to the limits and ranked. The designs are written as scenarios for `testbench run`.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, run_design="ask", DesignScenario="scenario", DesignResult="result", design_page="page")
