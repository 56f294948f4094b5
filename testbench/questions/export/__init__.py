"""How do other programs read a record or an identified model, and fly an aircraft?

Records become CSV, MAT, NetCDF or Parquet; models these, a python-control system, JSON, or a system for JSBSim;
aircraft C code, a unit for co-simulation, or a plain JSBSim model.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, export_record="ask", export_model="ask", export_aircraft="aircraft")
