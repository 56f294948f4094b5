"""What does the flight say while it flies: derivatives with their errors, how long until they are good enough, and what
is not as believed? Nothing is ever sent to the aircraft.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, fly_along="ask", Session="ask", live_page="page")
