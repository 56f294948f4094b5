"""What of the two papers comes out here?

Every printed number stands beside ours, with the reason where they part.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, reproduce="ask")
