"""Do the instruments of a record agree with each other, and which err by how much?

Rates and accelerations are integrated and held against airspeed, flow angles, attitude and height. The answer names
bias, scale, lag or delay where the data tell them; the records without them are written.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, compatibility="ask", compatibility_page="page")
