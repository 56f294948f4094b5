"""What do the same estimators say about recorded flights?

A description says where the files lie, which column is which channel in which unit, and what each record is used for.
The answer and the page are those of a run, without a truth beside them.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, identify="ask", RecordDescription="scenario")
