"""What is the gain of each sensor, over the same flights and noise?

Suites are compared in pairs with the same noise, by simulation and by information. The answer gives the significant
gains, and the best positions of sensors along the wing.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, compare="ask", CompareScenario="scenario", CompareResult="result", compare_page="page")
