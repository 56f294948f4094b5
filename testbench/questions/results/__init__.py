"""What did I find so far, and what differs between two runs?

The results of a folder with titles, answers and dates; two results side by side, table by table; whether one
still is what was written, and what it was made from.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, list_results="ask", compare_results="ask", verify_results="ask")
