"""Serve one page to this machine alone."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from testbench.core.errors import LimitError

HOST = "127.0.0.1"


@contextmanager
def serving(page: str, port: int) -> Iterator[ThreadingHTTPServer]:
    """Hold a server of ``page`` on 127.0.0.1; 0 lets the system choose a port (``server_port``).

    Raises:
        LimitError: the port is taken or not allowed.
    """
    body = page.encode()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            """Answer with the page at / and with nothing anywhere else."""
            found = self.path.split("?")[0] == "/"
            self.send_response(200 if found else 404)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.send_header("Content-Length", str(len(body) if found else 0))
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            if found:
                self.wfile.write(body)

        def log_message(self, format: str, *args: object) -> None:
            """Keep the terminal quiet."""

    try:
        server = ThreadingHTTPServer((HOST, port), Handler)
    except (OSError, OverflowError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not a port"
        raise LimitError(f"port {port} of {HOST} cannot be served: {reason}; choose another with --port") from None
    try:
        yield server
    finally:
        server.server_close()
