"""What can be identified with this input and these sensors?

A scenario states aircraft, air, inputs, sensors and the estimators of the records. The answer gives the prediction
error of each model on held-out flights, the modes that the input excites, and the gain of a sensor that one suite has
and another lacks.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, run="ask", Scenario="scenario", RunResult="result", run_page="page")
