"""May I drop a log in a browser and see what it tells?

A page on this machine alone takes logs, runs the command that a terminal would, says how far it is, and shows the page
of the result.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, Workbench="ask")
