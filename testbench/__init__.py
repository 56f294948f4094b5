"""A place to fly an identification experiment before the aircraft does.

In three lines::

    import testbench as tb

    result = tb.run("eolo_alpha")
    result.plot()

Functions take objects, names and paths alike; ``tb.load`` reads anything that has a name or a path, and ``tb.ask``
answers what a file asks. ``dir(testbench)`` lists what is meant to be used; each name says in its own help what it
does, with an example. Names are imported when they are first used, so that ``import testbench`` and the command line
start at once; ``__init__.pyi`` says where they lie.
"""

from __future__ import annotations

from testbench.core.lazily import declared, lazily

__version__ = "0.4.0"

_HOMES = declared(__file__)
__all__ = sorted(_HOMES)  # noqa: PLE0605
__getattr__ = lazily("testbench", **_HOMES)


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
