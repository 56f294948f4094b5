"""May I work in a browser: drop a log, look into it, ask, watch, compare?

A page on this machine alone shows flights, runs the commands that a terminal would, says how far they are, and shows
the pages of their results.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, Workbench="ask")
