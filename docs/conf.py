"""The documentation's build: `make docs` writes it to build/docs; every picture of the gallery is made on the way."""

from __future__ import annotations

import importlib
import importlib.util
import re
import sys
from pathlib import Path
from typing import Any

from sphinx.errors import ConfigError

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from testbench import __version__  # noqa: E402

_MISSING = [n for n in ("furo", "latex2mathml", "myst_parser") if importlib.util.find_spec(n) is None]
if _MISSING:
    raise ConfigError(f"the site needs {', '.join(_MISSING)}, not installed; pip install '.[docs]'")

project = "flight-testbench"
author = "the flight-testbench developers"
version = release = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = "flight-testbench"
html_show_sphinx = False
html_static_path = ["_static"]
html_css_files = ["equations.css"]
myst_enable_extensions = ["dollarmath", "deflist", "colon_fence"]
myst_heading_anchors = 3
nitpicky = False
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_default_options = {"members": True, "undoc-members": False}
napoleon_use_ivar = True
suppress_warnings = ["myst.header"]


def equations_stay_as_written(_app: Any, _what: str, _name: str, _object: Any, _options: Any, lines: list[str]) -> None:
    """Show indented blocks of docstrings, which are equations, as literal blocks, and bars as bars."""
    out: list[str] = []
    literal = False
    for i, line in enumerate(lines):
        indented = line.startswith("    ")
        if indented and not literal and (i == 0 or not lines[i - 1].strip()) and not _inside_list(out):
            out += ["::", ""]
            literal = True
        elif line.strip() and not indented:
            literal = False
        out.append(line if literal else line.replace("|", r"\|"))
    lines[:] = out


def types_are_no_links(_app: Any, _what: str, _name: str, _object: Any, _options: Any, lines: list[str]) -> None:
    """Keep the last underscore of a type, such as ``np.bool_``, from making a link of it."""
    lines[:] = [re.sub(r"(?<=\w)_(?!\w)", r"\\_", x) if x.startswith(":vartype") else x for x in lines]


def _inside_list(before: list[str]) -> bool:
    last = next((line for line in reversed(before) if line.strip() and not line.startswith("    ")), "")
    return last.lstrip().startswith((":", "-", "*", "..")) or last.endswith("::")


def setup(app: Any) -> None:
    """Write equations as MathML, which browsers draw without any script."""
    from docutils import nodes
    from latex2mathml.converter import convert
    from sphinx.writers.html5 import HTML5Translator

    def inline(self: HTML5Translator, node: nodes.Element) -> None:
        self.body.append(convert(node.astext()))
        raise nodes.SkipNode

    def block(self: HTML5Translator, node: nodes.Element) -> None:
        self.body.append(f'<div class="math">{convert(node.astext(), display="block")}</div>')
        raise nodes.SkipNode

    # Autodoc adds to the annotations of pydantic's classes, after which no class that takes any key can be made.
    for name in re.findall(r"automodule:: (\S+)", (ROOT / "docs" / "reference" / "python.md").read_text("utf-8")):
        importlib.import_module(name)
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    app.connect("autodoc-process-docstring", equations_stay_as_written, priority=1)
    app.connect("autodoc-process-docstring", types_are_no_links, priority=900)  # behind napoleon, which adds them


html_math_renderer = "mathml"
