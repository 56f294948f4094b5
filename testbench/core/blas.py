"""Linear algebra on one thread while the testbench computes.

The matrices here are small: threads of the linear algebra library wait for one another for longer than they compute,
and flights already use every core by processes. A command sets this before numpy is imported; a notebook cannot.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from contextvars import ContextVar
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")
SETTINGS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
"""Variables of the environment by which a user chooses the number of threads; what is chosen stays."""
_inside: ContextVar[bool] = ContextVar("inside", default=False)


def on_one_thread(function: Callable[P, T]) -> Callable[P, T]:
    """Return a function that computes with one thread of linear algebra, and leaves the number as it was.

    A number that the environment gives is kept; see :data:`SETTINGS`.
    """

    @functools.wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> T:
        if _inside.get() or any(name in os.environ for name in SETTINGS):
            return function(*args, **kwargs)
        import scipy.linalg  # noqa: F401  # brings a library of its own, which must be there to be limited
        from threadpoolctl import threadpool_limits

        token = _inside.set(True)
        try:
            with threadpool_limits(1, user_api="blas"):
                return function(*args, **kwargs)
        finally:
            _inside.reset(token)

    return limited
