"""How do other programs read a record or an identified model?

Records become CSV, MAT, NetCDF or Parquet; models these, a python-control system, JSON, or a system for JSBSim.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, export_record="ask", export_model="ask")
