"""Figures, tables and pages of what a run found; it reads results and judges nothing itself."""

from __future__ import annotations

from testbench.report.terminal import print_result
from testbench.report.write import record_keeper, write_results

__all__ = ["print_result", "record_keeper", "write_results"]
