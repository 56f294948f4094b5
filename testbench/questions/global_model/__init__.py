"""What are an aircraft's aerodynamic coefficients as functions of its state, over all that its flights have covered?

Flights -> coefficients felt (believed mass and engines) -> functions (terms by evidence) -> held-out flights, domain,
and, if asked, an aircraft that has these functions where it was flown.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, global_model="ask", GlobalFound="result")
