"""Which modes do outputs show whose input is unknown, such as those of a wing in turbulence?

The question takes records, a description of recorded flights, or a scenario of flight in turbulence that it flies
itself. The answer gives frequencies, damping ratios and shapes with their errors.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(
    __name__, fly_modes="ask", find_modes="ask", ModesScenario="scenario", ModesResult="result", modes_page="page"
)
