"""Chromium for tests of pages; without it, or without playwright, they are left out."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

BROWSER = next((b for b in map(shutil.which, ("chromium", "chromium-browser", "google-chrome")) if b), None)


@contextmanager
def chromium() -> Iterator[Any]:
    """Give a running browser of playwright, or skip the test that asks for it."""
    playwright = pytest.importorskip("playwright.sync_api", reason="the pages need playwright to be tried")
    if BROWSER is None:
        pytest.skip("the pages need Chromium to be tried")
    with playwright.sync_playwright() as p:
        running = p.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        yield running
        running.close()
