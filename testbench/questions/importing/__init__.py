"""What is in a flight log, and where are its manoeuvres?

PX4, ArduPilot and SIDPAC logs and tables are read. The answer lists channels with rates, gaps and assumptions; the
manoeuvres become records with a description for `testbench identify`.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, import_log="ask", write_import="ask")
