"""Compilation of kernels."""

from __future__ import annotations

from typing import Any

import numba
import pytest

from testbench.flight.batch.compiled import compiled


def test_kernels_compile_where_nothing_can_be_written(monkeypatch: pytest.MonkeyPatch) -> None:
    real = numba.njit

    def njit(*functions: Any, **options: Any) -> Any:
        if options.get("cache"):
            raise RuntimeError("cannot cache function: no locator available for file")
        return real(*functions, **options)

    monkeypatch.setattr(numba, "njit", njit)

    def half(x: float) -> float:
        return 0.5 * x

    assert compiled(half)(3.0) == 1.5
