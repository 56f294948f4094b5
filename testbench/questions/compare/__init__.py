"""Comparison: what each sensor buys, over the same flights and noise, by simulation and by information."""

from __future__ import annotations
