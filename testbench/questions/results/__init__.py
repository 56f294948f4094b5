"""Which results do I have, and what differs between two runs?

The results of a folder with titles, answers and dates; two results side by side, table by table; the provenance of one,
and whether it is unchanged.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, list_results="ask", compare_results="ask", verify_results="ask")
