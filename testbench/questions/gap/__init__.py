"""What does the simulation lack that the aircraft has?

Measured records are compared with the a-priori model. If they disagree, effects of a library are fitted and compared by
likelihood. A probable effect is named, added to the model, and validated on flights that were not used. workflow.py is
the sequence, name.py compares, explain.py decides and has the sentences; evidence/ analyses residuals, search/ flies
hypotheses.
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
