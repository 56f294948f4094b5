"""May I work in a browser: drop a log, inspect it, run questions, watch their progress, compare results?

A page on this machine alone shows flights, runs the commands of the terminal, and shows their progress and the pages of
their results.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, Workbench="ask")
