"""Names of a package that are imported when they are first used, so that the command line starts at once."""

from __future__ import annotations

import ast
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
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
            from difflib import get_close_matches  # takes longer to import than the rest of this

            near = [] if name.startswith("_") else get_close_matches(name, homes, 1)
            hint = f"; did you mean '{near[0]}'?" if near else ""
            raise AttributeError(f"module '{package}' has no attribute '{name}'{hint}")
        return getattr(import_module(f"{package}.{homes[name]}"), name)

    return find


def declared(file: str) -> dict[str, str]:
    """Return name -> module below the package, of what the stub (``.pyi``) beside a package's file imports.

    Type checkers read the names and their types from the stub, too, so that they are written once.
    """
    tree = ast.parse(Path(file).with_suffix(".pyi").read_text(encoding="utf-8"))
    return {
        alias.name: (node.module or "").partition(".")[2]
        for node in tree.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
