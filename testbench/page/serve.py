"""Serve pages to this machine alone: one address, GET only, few at a time, and to no page of another site."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import BoundedSemaphore
from typing import Any

from testbench.core.errors import LimitError

HOST = "127.0.0.1"
MOST_CONNECTIONS = 16
"""Served at once; more are closed, so that no page of a browser can use up the machine."""
PATIENCE_S = 10.0
"""After which a connection that says nothing is closed."""
Found = tuple[bytes, str]
"""What is at an address: its bytes and its media type."""


@contextmanager
def serving(page: str | Callable[[str], Found | None], port: int) -> Iterator[ThreadingHTTPServer]:
    """Hold a server on 127.0.0.1; 0 lets the system choose a port (``server_port``).

    A request must name this machine as its host, which a site that was pointed at 127.0.0.1 under a name of its own
    does not, and must not come from a page of another origin. A request that brings a body is refused unread.

    Args:
        page: what is at "/", or a function from the path, without its query, to what is there; None is nothing.
        port: to serve on.

    Raises:
        LimitError: the port is taken or not allowed.
    """
    only = page
    answer: Callable[[str], Found | None]
    if isinstance(only, str):
        body = only.encode()
        answer = lambda path: (body, "text/html; charset=utf-8") if path == "/" else None  # noqa: E731
    else:
        answer = only
    try:
        server = _Server((HOST, port), _handler(answer))
    except (OSError, OverflowError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not a port"
        raise LimitError(f"port {port} of {HOST} cannot be served: {reason}; choose another with --port") from None
    try:
        yield server
    finally:
        server.server_close()


class _Server(ThreadingHTTPServer):
    """A server that closes connections beyond :data:`MOST_CONNECTIONS` at once."""

    daemon_threads = True

    def __init__(self, *given: Any) -> None:
        self.free = BoundedSemaphore(MOST_CONNECTIONS)
        super().__init__(*given)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Serve in a thread of its own, if there is one left."""
        if self.free.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Serve, then free the place."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self.free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Keep the terminal quiet when a browser goes away."""


def _handler(answer: Callable[[str], Found | None]) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        server: _Server
        timeout = PATIENCE_S

        def do_GET(self) -> None:
            """Answer with what is at the path, or say why not."""
            own = {f"{name}:{self.server.server_port}" for name in (HOST, "localhost")}
            if self.headers.get("Host") not in own:
                self._say(403, b"", "text/plain")
                return
            origin = self.headers.get("Origin")
            if origin is not None and origin not in {f"http://{name}" for name in own}:
                self._say(403, b"", "text/plain")
                return
            if self.headers.get("Content-Length", "0") != "0" or "Transfer-Encoding" in self.headers:
                self.close_connection = True
                self._say(413, b"", "text/plain")
                return
            found = answer(self.path.split("?")[0].split("#")[0])
            self._say(200 if found else 404, *(found or (b"", "text/plain")))

        def _say(self, status: int, body: bytes, kind: str) -> None:
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Cache-Control", "no-store")
            self.send_header("X-Content-Type-Options", "nosniff")
            self.send_header("Cross-Origin-Resource-Policy", "same-origin")
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *args: object) -> None:
            """Keep the terminal quiet."""

    return Handler
