"""Compilation of functions of Python: once per installation, kept on disk where there is a place for it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from testbench.core.errors import MissingPackage, missing

try:
    import numba
except ImportError as error:
    raise MissingPackage(missing("environments need numba", "envs")) from error


def compiled(function: Callable[..., Any]) -> Any:
    """Return ``function`` compiled, in strict IEEE arithmetic; it must call no other of its kind."""
    try:
        return numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    except RuntimeError:  # no folder that can be written to: it is compiled anew in every process
        return numba.njit(nogil=True, error_model="numpy")(function)
