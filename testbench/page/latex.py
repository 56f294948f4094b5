"""Text of figures set by LaTeX: is there one, and what our words are in its language."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from testbench.core.errors import MissingPackage

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PREAMBLE = r"\usepackage[T1]{fontenc}\usepackage{textcomp}\usepackage{amsmath}\usepackage{amssymb}"
_GREEK = {
    "α": "alpha", "β": "beta", "γ": "gamma", "δ": "delta", "ε": "varepsilon", "ζ": "zeta", "η": "eta",
    "θ": "theta", "κ": "kappa", "λ": "lambda", "μ": "mu", "ν": "nu", "ξ": "xi", "π": "pi", "ρ": "rho", "σ": "sigma",
    "τ": "tau", "φ": "phi", "χ": "chi", "ψ": "psi", "ω": "omega", "Γ": "Gamma", "Δ": "Delta", "Θ": "Theta",
    "Λ": "Lambda", "Σ": "Sigma", "Φ": "Phi", "Ψ": "Psi", "Ω": "Omega", "µ": "mu", "×": "times", "·": "cdot", "±": "pm",
    "≤": "leq", "≥": "geq", "≈": "approx", "→": "rightarrow", "∞": "infty", "√": "surd", "≠": "neq", "−": "-",
}  # fmt: skip
_PLAIN = {
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "%": r"\%", "_": r"\_", "&": r"\&", "#": r"\#", "$": r"\$",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}", ">": r"\textgreater{}",
    "|": r"\textbar{}", '"': r"\textquotedbl{}", "°": r"\textdegree{}", "…": r"\ldots{}", "–": "--", "—": "---",
    "\N{NO-BREAK SPACE}": "~", "’": "'",
}  # fmt: skip
_RAISED = dict(zip("⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺", "0123456789-+", strict=True))
_LOWERED = dict(zip("₀₁₂₃₄₅₆₇₈₉", "0123456789", strict=True))
_ACCENTS = {"\N{COMBINING DOT ABOVE}": "dot", "\N{COMBINING CIRCUMFLEX ACCENT}": "hat", "\N{COMBINING MACRON}": "bar"}


def find_latex(formats: Sequence[str]) -> None:
    """Check that what matplotlib needs to set text by LaTeX is installed.

    Raises:
        MissingPackage: a program is not found.
    """
    needed = ["latex", "kpsewhich", *(["dvipng"] if "png" in formats else [])]
    missing = [name for name in needed if shutil.which(name) is None]
    if missing:
        raise MissingPackage(
            f"LaTeX text in figures needs the programs {', '.join(needed)}, got no {' and no '.join(missing)}; install "
            "LaTeX (on Debian: apt install texlive-latex-extra cm-super dvipng), or leave out --latex"
        )


def latex_text(text: str) -> str:
    """Return a text of ours as LaTeX that reads the same: nothing in it is a command.

    Example:
        >>> latex_text("δe, % of 10⁻²")
        '$\\\\delta$e, \\\\% of 10$^{-2}$'
    """
    out: list[str] = []
    k = 0
    while k < len(text):
        letter = text[k]
        family = next((f for f in (_RAISED, _LOWERED) if letter in f), None)
        if family is not None:
            end = k
            while end < len(text) and text[end] in family:
                end += 1
            out.append(f"${'^' if family is _RAISED else '_'}{{{''.join(family[c] for c in text[k:end])}}}$")
            k = end
            continue
        accent = _ACCENTS.get(text[k + 1 : k + 2])
        maths = _GREEK.get(letter)
        maths = maths if maths in (None, "-") else f"\\{maths}"
        if accent is not None:
            out.append(f"$\\{accent}{{{maths or letter}}}$")
            k += 1
        else:
            out.append(_PLAIN.get(letter, letter) if maths is None else f"${maths}$")
        k += 1
    return "".join(out)


def set_by_latex(figure: Figure) -> None:
    """Make LaTeX of every text of a figure, and of those that its axes make of their ticks when they are drawn."""
    from matplotlib.text import Text

    ticks: set[int] = set()
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter(_formatter(axis.get_major_formatter()))
            ticks |= {id(text) for tick in axis.get_major_ticks() for text in (tick.label1, tick.label2)}
    for text in {id(text): text for text in figure.findobj(Text)}.values():
        if id(text) not in ticks and isinstance(text, Text):
            text.set_text("\n".join(latex_text(line) for line in text.get_text().split("\n")))


def _formatter(inner: Any) -> Any:
    """Return a formatter of ticks that makes LaTeX of what another returns."""
    from matplotlib.ticker import Formatter

    class OfLatex(Formatter):
        """The other's labels, as LaTeX; numbers that matplotlib has set for LaTeX already stay."""

        def __call__(self, x: float, pos: int | None = None) -> str:
            return _tick(inner(x, pos))

        def format_ticks(self, values: Any) -> list[str]:
            return [_tick(text) for text in inner.format_ticks(values)]

        def set_locs(self, locs: Any) -> None:
            inner.set_locs(locs)

        def get_offset(self) -> str:
            return str(inner.get_offset())

    inner_axis = getattr(inner, "axis", None)
    out = OfLatex()
    if inner_axis is not None:
        out.set_axis(inner_axis)
    return out


def _tick(text: str) -> str:
    return text if "\\mathdefault" in text else latex_text(text)
