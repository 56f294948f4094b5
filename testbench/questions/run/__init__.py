"""What do this input and these sensors tell?

A scenario says what flies, through which air, with which inputs and sensors, and which estimators look at the
records. The answer says how well each model predicts flights that it has not seen, which modes the input excites, and
what a sensor that one suite has and another lacks has bought.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, run="ask", Scenario="scenario", RunResult="result", run_page="page")
