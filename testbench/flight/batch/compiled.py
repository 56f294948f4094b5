"""Compilation of the kernels: once per installation, kept on disk where there is a place for it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

SOURCES = hashlib.sha256(b"".join(p.read_bytes() for p in sorted(Path(__file__).parent.glob("*.py")))).hexdigest()[:12]
"""Hash of the code of the batch."""


def compiled(function: Callable[..., Any]) -> Any:
    """Return ``function`` compiled; strict IEEE arithmetic, so that batch size and order change no bit.

    Numba notices that the file of a kernel has changed, but not those of the kernels that it calls: the name under
    which it is kept tells all of them apart.
    """
    function.__qualname__ = f"{function.__name__}_{SOURCES}"
    try:
        return numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    except RuntimeError:  # no folder that can be written to: it is compiled anew in every process
        return numba.njit(nogil=True, error_model="numpy")(function)
