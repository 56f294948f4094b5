"""Linear algebra computes on one thread inside, and is left as it was."""

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import testbench as tb
from testbench.core.blas import SETTINGS, on_one_thread


def threads() -> set[int]:
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


@pytest.fixture
def unset(monkeypatch):
    for name in SETTINGS:
        monkeypatch.delenv(name, raising=False)


def test_one_thread_inside_and_as_many_as_before_afterwards(unset):
    def seen(nested: bool) -> list[set[int]]:
        return [threads(), *(on_one_thread(seen)(False) if nested else [])]

    with threadpool_limits(2, user_api="blas"):
        assert on_one_thread(seen)(True) == [{1}, {1}]
        assert threads() == {2}
        with pytest.raises(ZeroDivisionError):
            on_one_thread(lambda: 1 / 0)()
        assert threads() == {2}


@pytest.mark.parametrize("name", SETTINGS)
def test_what_the_environment_chooses_is_kept(unset, monkeypatch, name):
    monkeypatch.setenv(name, "2")
    with threadpool_limits(2, user_api="blas"):
        assert on_one_thread(threads)() == {2}


def test_what_takes_long_is_limited():
    for name in ("run", "identify", "estimate", "run_gap", "run_design", "compare", "make_plan", "tangents"):
        assert hasattr(getattr(tb, name), "__wrapped__"), name
