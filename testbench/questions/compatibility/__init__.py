"""Do the instruments of a record agree with each other, and how large are their errors?

Rates and accelerations are integrated and compared with airspeed, flow angles, attitude and height. The answer gives
bias, scale, lag or delay if the data determine them; the corrected records are written.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, compatibility="ask", compatibility_page="page")
