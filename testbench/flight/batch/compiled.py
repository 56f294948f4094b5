"""Compilation of the kernels: once per installation, kept on disk where there is a place for it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba import types
from numba.extending import intrinsic

SOURCES = hashlib.sha256(b"".join(p.read_bytes() for p in sorted(Path(__file__).parent.glob("*.py")))).hexdigest()[:12]
"""Hash of the code of the batch."""
LANES = 8
"""Flights of a block, always: known when the kernels are compiled, so that they are vectorised over the flights.

One row of registers fills one cache line, and one vector where the processor has the widest. A block that is not full
takes as long as a full one: searches, which ask for three to six flights of one model, take 0.3 to 0.4 of the time that
they take in blocks of 32, and hundreds of flights at once 1.2 to 1.3 of it (10 s of eolo, taurus and c172p).
"""


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


@intrinsic
def _pointer(context: Any, address: Any) -> Any:
    """Return the pointer to doubles at an address."""
    signature = types.CPointer(types.float64)(address)

    def generate(target: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], target.get_value_type(signature.return_type))

    return signature, generate


@numba.njit(inline="always")
def lanes(R: Any) -> Any:  # pragma: no cover
    """Return the registers (registers, LANES) with a width that the compiler knows.

    From it follows that rows do not overlap, which is what keeps loops over flights from being vectorised otherwise.
    """
    return numba.carray(_pointer(R.ctypes.data), (1 << 20, LANES))  # type: ignore[call-arg]
