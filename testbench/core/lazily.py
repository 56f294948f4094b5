"""Names of a package that are imported when they are first used, so that the command line starts at once."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any


def lazily(package: str, **homes: str) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a package whose names lie in modules of it.

    Args:
        package: its ``__name__``.
        homes: name -> module below the package.
    """

    def find(name: str) -> Any:
        """Return one of the names; its module is imported now."""
        if name not in homes:
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        return getattr(import_module(f"{package}.{homes[name]}"), name)

    return find
