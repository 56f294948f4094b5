"""Which results of the two papers are reproduced here?

Every printed number is compared with ours, with the reason for a difference.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, reproduce="ask")
