"""Serve the studio's page to this machine alone."""

from __future__ import annotations

from contextlib import AbstractContextManager

from testbench.page import serve
from testbench.page.serve import HOST, Answer, Server

__all__ = ["HOST", "serving"]


def serving(page: str, port: int) -> AbstractContextManager[Server]:
    """Hold a server of ``page`` at / on 127.0.0.1; 0 lets the system choose a port (``server_port``).

    Raises:
        LimitError: the port is taken or not allowed.
    """
    found = Answer(page.encode())
    return serve.serving(lambda path: found if path == "/" else None, port)
