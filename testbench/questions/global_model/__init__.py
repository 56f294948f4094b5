"""What are an aircraft's aerodynamic coefficients as functions of its state, over the envelope of its flights?

Flights -> measured coefficients (with known mass and engines) -> functions (terms by evidence) -> held-out flights,
domain, and, if wanted, an aircraft that has these functions inside that domain.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, global_model="ask", GlobalFound="result")
