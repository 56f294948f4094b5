"""What are the response and the expected errors of an input, while I drag it in a browser?

One interactive page computes spectrum, response and expected errors in the browser, before any flight.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, studio_models="ask")
