"""Make matplotlib's SVG small: a page holds many figures, and half of each is spaces, names and digits nobody sees."""

from __future__ import annotations

import re

_PATH = re.compile(r' d="([^"]*)"')
_STEP = re.compile(r"([MLQCz])([^MLQCz]*)")
_PLACE = re.compile(r'(?:translate\(|\b[xy]=")[^)"]*')  # not a scale: its digits count
_NUMBER = re.compile(r"-?\d+\.\d\d\d+")
_NOISE = re.compile(r"<\?xml.*?\?>|<!DOCTYPE.*?>|<metadata>.*?</metadata>|<!--.*?-->", re.DOTALL)
_NAMES = re.compile(r'<g id="[^"]*"')
_BETWEEN = re.compile(r">\s+<")
_AT = re.compile(r' transform="translate\(([^ )]+) 0\)"(?=/>)')  # of a letter, which a place says shorter
_STYLE = re.compile(r' style="[^"]*"')
_LONG_LINE = 20  # points from which a line is told to a tenth of a point, not a hundredth


def small_svg(svg: str) -> str:
    """Return ``svg`` as it looks, in about a third of the letters: relative coordinates, cut to what can be seen.

    Points are rounded where they stand, so that no error adds up along a line.
    """
    svg = _NAMES.sub("<g", _NOISE.sub("", svg))
    svg = _BETWEEN.sub("><", svg).replace("DejaVuSans", "f").strip()
    svg = _AT.sub(r' x="\1"', svg).replace("xlink:href", "href")
    svg = _STYLE.sub(lambda style: style[0].replace(": ", ":").replace("; ", ";"), svg)
    svg = _PATH.sub(lambda path: f' d="{_relative(path[1])}"', svg)
    return _PLACE.sub(lambda place: _NUMBER.sub(lambda number: _short(float(number[0]), 2), place[0]), svg)


def _relative(path: str) -> str:
    """Return path data with relative steps after the first point."""
    steps = [(letter, [float(x) for x in rest.split()]) for letter, rest in _STEP.findall(path)]
    curved = any(letter in "QC" for letter, _ in steps)
    digits = 1 if len(steps) > _LONG_LINE and not curved else 2
    scale, out, before = 10**digits, [], ""
    x = y = start_x = start_y = 0
    for letter, values in steps:
        if letter == "z":
            out.append("z")
            x, y, before = start_x, start_y, "z"
            continue
        points = [round(v * scale) for v in values]
        moved = [p - (y if k % 2 else x) for k, p in enumerate(points)]
        if letter == "M":
            start_x, start_y = points[0], points[1]
        command = letter.lower()
        out.append(_joined(command if command != before or command == "m" else "", moved, scale, digits))
        x, y, before = points[-2], points[-1], command
    return "".join(out)


def _joined(command: str, values: list[int], scale: int, digits: int) -> str:
    texts = [_short(v / scale, digits) for v in values]
    out = command + texts[0] if command else texts[0] if texts[0].startswith("-") else " " + texts[0]
    return out + "".join(text if text.startswith("-") else " " + text for text in texts[1:])


def _short(value: float, digits: int) -> str:
    """Return a number without trailing zeros or a zero before the point."""
    text = f"{value:.{digits}f}"
    text = (text.rstrip("0").rstrip(".") if "." in text else text).replace("-0.", "-.")
    text = text[1:] if text.startswith("0.") else text
    return "0" if text in ("-0", "", "-") else text
