"""What does each sensor buy, over the same flights and noise?

Suites are compared in pairs with the same noise, by simulation and by information. The answer says which gains are more
than chance, and where sensors along the wing tell most.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, compare="ask", CompareScenario="scenario", CompareResult="result", compare_page="page")
