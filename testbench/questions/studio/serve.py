"""Serve one page to this machine alone."""

from __future__ import annotations

from testbench.page.serve import HOST, serving

__all__ = ["HOST", "serving"]
