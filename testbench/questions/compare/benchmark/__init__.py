"""How do methods of identification fare on flights whose truth is known, each with one thing in the way?

Every method of the table, and those that a user brings, on the same flights with the same noise; recorded flights with
printed results beside them. One hash names data, settings and seeds, so that a result can be cited.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, benchmark="ask", Benchmark="result", benchmark_page="page")
