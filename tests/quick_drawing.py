"""Figures that are made and not rendered: for tests that ask what a page says, not what its figures look like.

Rendering takes half the time of a test that writes a page. Every panel, curve and label of a figure's wide form is
still made, so that what cannot be drawn raises; the modules that judge figures are marked ``drawn`` and render them.
"""

import base64
from collections.abc import Iterator
from contextlib import contextmanager
from unittest import mock

from testbench.page import draw
from testbench.page.figure import Drawing, Plate

_PIXEL = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
)


def _made(self: Plate, wide: bool = True, png: bool = True) -> Drawing:
    width, height = 72.0 * self.make(wide).get_size_inches() if wide else (270.0, 200.0)
    svg = f'<svg width="{width:g}pt" height="{height:g}pt" viewBox="0 0 {width:g} {height:g}" xmlns="http://www.w3.org/2000/svg"/>'
    return Drawing(svg, _PIXEL if png else b"")


_RENDER, _PDF = Plate.draw, draw.pdf_pages


class Quick:
    """Whether figures are rendered, for the processes of commands, too."""

    on = False


@contextmanager
def quick_drawing() -> Iterator[None]:
    """Render no figure within the block, nor in the commands that it runs."""
    with (
        mock.patch.object(Plate, "draw", _made),
        mock.patch.object(draw, "pdf_pages", return_value=b"%PDF-1.4\n"),
        mock.patch.object(Quick, "on", True),
    ):
        yield


@contextmanager
def rendering() -> Iterator[None]:
    """Render figures within the block after all."""
    with (
        mock.patch.object(Plate, "draw", _RENDER),
        mock.patch.object(draw, "pdf_pages", _PDF),
        mock.patch.object(Quick, "on", False),
    ):
        yield


@contextmanager
def on_paper() -> Iterator[None]:
    """Render pages of PDF within the block, but no pictures."""
    with mock.patch.object(draw, "pdf_pages", _PDF):
        yield
