"""What does the simulation lack that the aircraft has?

Measured records are compared with the believed aircraft. Where they disagree, effects of a library are fitted and
compared by likelihood. One that explains the residual is named, added to the model, and judged on flights that were not
used. evidence/ says what the residuals show, search/ tries hypotheses, decide.py keeps or refutes a name, tell.py has
the words.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(
    __name__,
    run_gap="ask",
    run_flights="ask",
    find_gap="workflow",
    plan_gap="plan",
    GapScenario="scenario",
    gap_page="page",
)
