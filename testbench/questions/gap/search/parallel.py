"""Work of a search done ahead in processes of its own; :mod:`testbench.core.processes` does it."""

from __future__ import annotations

from testbench.core.processes import Ahead, cores, processes, spread

__all__ = ["Ahead", "cores", "processes", "spread"]
