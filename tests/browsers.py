"""Chromium for tests of pages; without it, or without playwright, they are left out."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

BROWSER = next((b for b in map(shutil.which, ("chromium", "chromium-browser", "google-chrome")) if b), None)


def launched(p: Any) -> Any:
    """Return a new browser of playwright; its socket lies in /tmp, as a path of one has at most 107 letters."""
    short = {**os.environ, "TMPDIR": "/tmp"}
    return p.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"], env=short)


@contextmanager
def chromium() -> Iterator[Any]:
    """Give a running browser of playwright, or skip the test that asks for it."""
    playwright = pytest.importorskip("playwright.sync_api", reason="the pages need playwright to be tried")
    if BROWSER is None:
        pytest.skip("the pages need Chromium to be tried")
    with playwright.sync_playwright() as p:
        running = launched(p)
        yield running
        running.close()


class Tab:
    """One tab for the tests of a module, since a new one takes longer than the page.

    Attributes:
        page: of playwright.
        told: what the page wrote to the console, the dialogues it opened, and what it fetched from elsewhere.
    """

    def __init__(self, browser: Any) -> None:
        self.page, self.told = browser.new_context(accept_downloads=True).new_page(), list[str]()
        self.page.on("console", lambda m: self.told.append(m.text))
        self.page.on("pageerror", lambda e: self.told.append(str(e)))
        self.page.on("dialog", lambda d: (self.told.append(d.message), d.dismiss()))
        own = ("file:", "data:", "blob:", "about:")
        self.page.on("request", lambda r: r.url.startswith(own) or self.told.append(r.url))

    def show(self, address: str, width: int = 1280, height: int = 900) -> Any:
        """Open a page as for the first time; return that of playwright."""
        self.page.goto("about:blank")
        self.page.emulate_media(media="screen")
        self.page.set_viewport_size({"width": width, "height": height})
        self.page.mouse.move(0, 0)
        self.page.goto(address)
        return self.page
