"""What does the simulation lack that the aircraft has?

Measured records are compared with the believed aircraft. Where they disagree, effects of a library are fitted and
compared by likelihood. What is probable is named, added to the model, and judged on flights that were not used.
workflow.py asks, name.py weighs, explain.py decides and has the words; evidence/ says what the residuals show, search/
flies hypotheses.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(
    __name__,
    run_gap="ask",
    run_flights="ask",
    GapSearch="workflow",
    find_gap="workflow",
    plan_gap="plan",
    GapScenario="scenario",
    gap_page="page",
)
