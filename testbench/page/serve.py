"""Serve pages to this machine alone, or at one of its addresses that is named: the one server of the house.

It listens on 127.0.0.1 unless told otherwise. That alone keeps nobody out: any page in the browser of this machine may
send requests here, and a name that its owner lets point to 127.0.0.1 makes it one origin with us (DNS rebinding).
Therefore the Host must be ours, and the Origin, where there is one; whoever sends a body must state it. Connections,
the size of a request and its time are limited. One connection carries one request: GET or HEAD, or POST where a server
takes something.
"""

from __future__ import annotations

import io
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import BoundedSemaphore
from typing import Any
from urllib.parse import unquote, urlsplit

from testbench.core.errors import LimitError

HOST = "127.0.0.1"
CONNECTIONS = 32  # at once; a browser opens six
LINE = 4096  # bytes of the request line
HEAD = 16_384  # bytes of it and all headers; browsers send one or two thousand
READ_S = 5.0  # for the whole request
WRITE_S = 30.0  # for the whole answer
MOST = 4_000_000_000  # bytes of a body
ENDING_S = 1.0  # for threads to end once their connections are closed
_HEADERS = (
    ("Cache-Control", "no-store"),
    ("X-Content-Type-Options", "nosniff"),
    ("X-Frame-Options", "SAMEORIGIN"),
    ("Referrer-Policy", "no-referrer"),
    ("Cross-Origin-Resource-Policy", "same-origin"),
)


@dataclass(frozen=True)
class Answer:
    """What is sent for a path: a body with its media type. A body in parts is sent as they come, until they end."""

    body: bytes | Iterator[bytes]
    kind: str = "text/html; charset=utf-8"
    status: HTTPStatus = HTTPStatus.OK


Take = Callable[[str, Iterator[bytes]], Answer | None]
"""What is done with a path and the parts of a body that is sent to it; None: 404."""


class Server(ThreadingHTTPServer):
    """A server of at most :data:`CONNECTIONS` connections at once; what comes beyond them is turned away with 503.

    Args:
        port: on 127.0.0.1; 0 lets the system choose (``server_port``).
        answer: gives what is sent for a path, such as "/" or "/runs.csv", unquoted and without its query; None: 404.
        take: the same of POST, of a path and a body of at most :data:`MOST` bytes; nothing is taken if not given.
        host: the address of this machine that it listens on; whoever reaches it may ask, so that paths need a token.

    Raises:
        LimitError: the port is taken or not allowed, or the address is not one of this machine.
    """

    daemon_threads = True
    request_queue_size = CONNECTIONS

    def __init__(
        self, port: int, answer: Callable[[str], Answer | None], take: Take | None = None, host: str = HOST
    ) -> None:
        self.answer, self.take, self.host = answer, take, host
        self._room = BoundedSemaphore(CONNECTIONS)
        self._open: set[Any] = set()
        try:
            super().__init__((host, port), _Handler)
        except (OSError, OverflowError) as error:
            reason = error.strerror if isinstance(error, OSError) else "not a port"
            raise LimitError(f"port {port} of {host} cannot be served: {reason}; choose another with --port") from None

    @property
    def hosts(self) -> tuple[str, ...]:
        """Names that requests may call us by."""
        names = (HOST, "localhost", "[::1]") if self.host == HOST else (self.host,)
        return tuple(f"{n}:{self.server_port}" for n in names) + (names if self.server_port == 80 else ())

    def until_ended(self, path: str = "/") -> None:
        """Say where it is to be found, and serve until Ctrl-C or a signal of the system."""
        print(f"Open http://{HOST}:{self.server_port}{path} in a browser; Ctrl-C ends.", flush=True)
        try:
            self.serve_forever()
        except KeyboardInterrupt:
            print("Ended.")

    def process_request(self, request: Any, client_address: Any) -> None:
        """Serve a connection in a thread of its own, if there is room for one."""
        if not self._room.acquire(blocking=False):
            with _broken():
                request.settimeout(0.0)
                request.sendall(b"HTTP/1.0 503 Service Unavailable\r\nConnection: close\r\nContent-Length: 0\r\n\r\n")
            self.shutdown_request(request)
            return
        try:
            super().process_request(request, client_address)
        except Exception:  # no thread was started; an interrupt may come as late as when one has made room already
            self._room.release()
            raise

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Serve a connection, and make room for another."""
        self._open.add(request)
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._open.discard(request)
            self._room.release()

    def server_close(self) -> None:
        """Close the server and the connections that are open, whose threads must not outlive the interpreter."""
        super().server_close()
        for request in list(self._open):
            with _broken():
                request.shutdown(socket.SHUT_RDWR)
        end = time.monotonic() + ENDING_S
        while self._open and time.monotonic() < end:
            time.sleep(0.01)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of a client that went away."""


@contextmanager
def serving(
    answer: Callable[[str], Answer | None], port: int, take: Take | None = None, host: str = HOST
) -> Iterator[Server]:
    """Hold a :class:`Server`; ``serve_forever`` serves, and the block's end closes it.

    Raises:
        LimitError: the port is taken or not allowed.
    """
    server = Server(port, answer, take, host)
    try:
        yield server
    finally:
        server.server_close()


class _Handler(BaseHTTPRequestHandler):
    server: Server
    server_version, sys_version = "testbench", ""

    def handle(self) -> None:
        """Read one request within its limits, answer it, and end the connection."""
        with _broken():
            head, fault = self._head()
            self.connection.settimeout(WRITE_S)
            self.rfile = io.BytesIO(head)
            if fault is not None:
                self.requestline, self.command = "", ""
                self.send_error(fault)
            else:
                self.handle_one_request()
            self.wfile.flush()
            self._drain()

    def _head(self) -> tuple[bytes, HTTPStatus | None]:
        """Return request line and headers, or what is wrong with them."""
        head, end = b"", time.monotonic() + READ_S
        while not head.endswith((b"\r\n\r\n", b"\n\n")) and b"\r\n\r\n" not in head and b"\n\n" not in head:
            if len(head) > LINE and b"\n" not in head[:LINE]:
                return b"", HTTPStatus.REQUEST_URI_TOO_LONG
            if len(head) > HEAD:
                return b"", HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE
            left = end - time.monotonic()
            try:
                self.connection.settimeout(max(left, 1e-3))
                got = self.connection.recv(4096)
            except TimeoutError:
                got = b""
                left = 0.0
            if left <= 0.0:
                return b"", HTTPStatus.REQUEST_TIMEOUT
            if not got:
                raise ConnectionError  # it closed before it had asked
            head += got
        return head, None

    def _drain(self) -> None:
        """Take what was sent beyond the request, up to a limit: unread, it would reset the connection before the answer
        has been read.
        """
        self.connection.shutdown(socket.SHUT_WR)
        self.connection.settimeout(0.2)
        for _ in range(16):
            if not self.connection.recv(65_536):
                return

    def do_GET(self) -> None:
        """Answer with what the path holds."""
        self._answer(self._fault(0), self.server.answer)

    do_HEAD = do_GET

    def do_POST(self) -> None:
        """Take what is sent to a path, and answer."""
        take = self.server.take
        if take is None:
            self.send_error(HTTPStatus.NOT_IMPLEMENTED)
        else:
            fault = self._fault(MOST) or (None if self.headers.get("Origin") else HTTPStatus.FORBIDDEN)
            self._answer(fault, lambda path: take(path, self._body()))

    def _answer(self, fault: HTTPStatus | None, answer: Callable[[str], Answer | None]) -> None:
        if fault is not None:
            self.send_error(fault)
            return
        found = answer(unquote(urlsplit(self.path).path))
        if found is None:
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        self._send(found.status, found)

    def _body(self) -> Iterator[bytes]:
        """Yield the body as it comes; a client that says nothing for long ends its connection."""
        left = int(self.headers.get("Content-Length", "0"))
        while left:
            self.connection.settimeout(WRITE_S)
            got = self.rfile.read(left) or self.connection.recv(min(left, 1 << 16))  # what came with the head is first
            if not got:
                raise ConnectionError
            left -= len(got)
            yield got
        self.connection.settimeout(WRITE_S)

    def _fault(self, most: int) -> HTTPStatus | None:
        """Return why the request is refused: its body is too large, it calls us by another name, or is another page's.

        Args:
            most: bytes that its body may have.
        """
        get = self.headers.get_all
        lengths = [n.strip() or "0" for n in get("Content-Length", [])]
        known = len(lengths) < 2 and all(n.isdecimal() and len(n) < 20 and int(n) <= most for n in lengths)
        if get("Transfer-Encoding") or not known:
            return HTTPStatus.REQUEST_ENTITY_TOO_LARGE
        hosts = get("Host", [])
        if len(hosts) > 1 or not self.path.startswith("/"):
            return HTTPStatus.BAD_REQUEST
        if not hosts or hosts[0].strip().lower() not in self.server.hosts:
            return HTTPStatus.MISDIRECTED_REQUEST
        ours = {f"http://{host}" for host in self.server.hosts}
        if any(origin.strip().lower() not in ours for origin in get("Origin", [])):
            return HTTPStatus.FORBIDDEN
        return None

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Answer with a status and its words alone: nothing of the request is quoted."""
        status = HTTPStatus(code)
        self._send(status, Answer(f"{status.value} {status.phrase}\n".encode(), "text/plain; charset=utf-8"))

    def _send(self, status: HTTPStatus, answer: Answer) -> None:
        self.request_version = "HTTP/1.0"  # what is no request gets a status line too
        self.send_response(status.value, status.phrase)
        parts = iter([answer.body]) if isinstance(answer.body, bytes) else answer.body
        size = [("Content-Length", str(len(answer.body)))] if isinstance(answer.body, bytes) else []
        for name, value in (*_HEADERS, ("Content-Type", answer.kind), *size):
            self.send_header(name, value)
        self.send_header("Connection", "close")
        self.end_headers()
        if self.command != "HEAD":
            for part in parts:
                self.wfile.write(part)
        self.close_connection = True

    def log_message(self, format: str, *args: object) -> None:
        """Keep the terminal quiet."""


@contextmanager
def _broken() -> Iterator[None]:
    """A client that goes away, or does not read, ends its connection and nothing else."""
    try:
        yield
    except (OSError, ValueError):  # ValueError: a file that is closed
        return
