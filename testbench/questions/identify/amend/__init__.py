"""What do the identified derivatives make of the user's aircraft, and does it fly as the flight did?

Identified -> choose (which derivatives, of which model) -> reach (increments of coefficients by which the linearised
aircraft has them) -> folder (a new aircraft) -> replay (the recorded flight through the old and the new one)
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, amend="ask", Amended="result")
