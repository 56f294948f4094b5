"""What does an input do and tell, while I drag it in a browser?

One interactive page computes spectrum, response and the errors to expect by itself, before anything is flown.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, studio_models="ask")
