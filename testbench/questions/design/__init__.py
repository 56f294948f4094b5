"""Which input, how large and how long, tells the wanted parameters or modes inside the limits?

Every family of signals is screened by spectral energy and information, the best are refined, flown in the simulator,
scaled to the limits and ranked. Scenarios that `testbench run` flies come out.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, run_design="ask", DesignScenario="scenario", DesignResult="result", design_page="page")
