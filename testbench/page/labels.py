"""Names, symbols and units as a reader sees them: degrees for angles, short names for cases, names safe for files."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from testbench.core.channels import channel
from testbench.core.constants import DEG_RAD, PERCENT
from testbench.core.store import is_plain

_POWERS = str.maketrans("23", "²³")


def shown_unit(name: str) -> tuple[float, str]:
    """Return the factor from SI to the shown unit of channel ``name``, and that unit: deg for rad, % for throttle.

    Raises:
        ChannelError: the channel is not in the table.
    """
    unit = channel(name).unit
    if unit.startswith("rad"):
        return 1.0 / DEG_RAD, "deg" + unit[3:].translate(_POWERS)
    if name in {"thr", "thr_cmd"}:
        return 1.0 / PERCENT, "%"
    return 1.0, "" if unit == "1" else unit.translate(_POWERS)


def symbol(name: str) -> str:
    """Return the symbol of channel ``name``."""
    return channel(name).symbol


def axis_label(name: str, deviation: bool = False) -> str:
    """Return symbol and shown unit, "Δα, deg" for a deviation from trim."""
    unit = shown_unit(name)[1]
    return ("Δ" if deviation else "") + symbol(name) + (f", {unit}" if unit else "")


def ratio_unit(output: str, given: str) -> tuple[float, str]:
    """Return the factor from SI to shown units of a response ``output`` per ``given``, and the unit in words."""
    (top, top_unit), (bottom, bottom_unit) = shown_unit(output), shown_unit(given)
    top_text = f"({top_unit})" if "/" in top_unit else top_unit or "1"
    return top / bottom, f"{top_text}/{bottom_unit or '1'}"


def unique(names: Sequence[str]) -> list[str]:
    """Return ``names`` with " (2)", " (3)" behind the second and third of the same name."""
    seen: dict[str, int] = {}
    out = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        out.append(name if seen[name] == 1 else f"{name} ({seen[name]})")
    return out


def file_stem(name: str) -> str:
    """Return ``name`` with all but letters, digits, dot, minus and underscore replaced by "_", fit for a file name."""
    stem = re.sub(r"[^A-Za-z0-9._-]+", "_", name).strip("._")[:120].rstrip(".") or "unnamed"
    return stem if is_plain(stem) else f"_{stem}"


def number(value: float, digits: int = 3) -> str:
    """Return ``value`` to so many significant digits, with a power of ten only where needed, and a true minus sign."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}".replace("-", "−")
    if not 1e-3 <= abs(value) < 1e5:
        size, power = f"{value:.{digits - 1}e}".split("e")
        return f"{size}·10{superscript(int(power))}".replace("-", "−")
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:.{decimals}f}".replace("-", "−")


def superscript(power: int) -> str:
    """Return a whole number in superscript digits."""
    return str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
