"""Which models do the same estimators find in recorded flights?

A description states where the files are, the channel and unit of each column, and the use of each record. The answer
and the page are those of a run, without a truth.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, identify="ask", RecordDescription="scenario")
