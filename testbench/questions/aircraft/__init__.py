"""How does an aircraft trim over its speeds, which modes has it, where does it flutter?

It is trimmed and linearised over its speed range. The answer names the modes over speed and the onset of instability;
the model can be written as plain JSBSim XML.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, survey="ask", Survey="ask", aircraft_page="page")
