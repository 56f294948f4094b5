"""The server against what does not behave: other names and origins, large and slow requests, too many of them."""

import socket
import time
from contextlib import contextmanager
from threading import Thread

import pytest

from testbench.page import serve
from testbench.page.serve import HOST, Answer, serving

pytestmark = pytest.mark.drawn

PAGE = b"<p>page</p>"


@pytest.fixture
def server():
    with serving({"/": Answer(PAGE), "/a b.csv": Answer(b"1,2\n", "text/csv")}.get, 0) as running:
        Thread(target=running.serve_forever, args=(0.05,), daemon=True).start()
        yield running
        running.shutdown()


@contextmanager
def connected(server):
    with socket.create_connection((HOST, server.server_port), timeout=10.0) as s:
        yield s


def everything(s):
    out = b""
    while got := s.recv(65_536):
        out += got
    return out


def asked(server, head: bytes) -> tuple[int, bytes]:
    """Return status and body of a raw request; $ stands for the port."""
    with connected(server) as s:
        s.sendall(head.replace(b"$", str(server.server_port).encode()))
        answer, _, body = everything(s).partition(b"\r\n\r\n")
    return int(answer.split()[1]), body


def get(server, *headers: bytes, path: bytes = b"/") -> tuple[int, bytes]:
    return asked(server, b"\r\n".join([b"GET " + path + b" HTTP/1.1", *headers, b"", b""]))


OURS = b"Host: 127.0.0.1:$"


@pytest.mark.parametrize("host", [b"127.0.0.1:$", b"localhost:$", b"LocalHost:$", b"[::1]:$"])
def test_it_answers_to_its_own_names(server, host):
    assert get(server, b"Host: " + host) == (200, PAGE)


@pytest.mark.parametrize(
    "host",
    [b"evil.example:$", b"evil.example", b"127.0.0.1", b"127.0.0.1:1", b"127.0.0.1:$.evil.example", b"", b"[::2]:$"],
)
def test_another_name_is_misdirected(server, host):
    assert get(server, b"Host: " + host)[0] == 421


def test_no_name_and_two_names_are_refused(server):
    assert get(server)[0] == 421
    assert get(server, OURS, b"Host: evil.example")[0] == 400
    assert get(server, OURS, path=b"http://evil.example/")[0] == 400


@pytest.mark.parametrize("origin", [b"http://127.0.0.1:$", b"http://localhost:$", b"http://[::1]:$"])
def test_its_own_pages_may_ask(server, origin):
    assert get(server, OURS, b"Origin: " + origin) == (200, PAGE)


@pytest.mark.parametrize(
    "origin", [b"https://evil.example", b"null", b"http://127.0.0.1:1", b"https://127.0.0.1:$", b""]
)
def test_other_pages_may_not(server, origin):
    assert get(server, OURS, b"Origin: " + origin)[0] == 403


def test_paths_are_unquoted_and_others_are_not_found(server):
    assert get(server, OURS, path=b"/a%20b.csv?x=1") == (200, b"1,2\n")
    for path in (b"/etc/passwd", b"/../", b"//x", b"/%00", b"/%ff", b"/" + b"a" * 3000):
        status, body = get(server, OURS, path=path)
        assert (status, body) == (404, b"404 Not Found\n")


def test_head_has_no_body_and_other_methods_are_refused(server):
    assert asked(server, b"HEAD / HTTP/1.1\r\nHost: localhost:$\r\n\r\n") == (200, b"")
    for method in (b"POST", b"PUT", b"DELETE", b"OPTIONS", b"X" * 50):
        status, body = asked(server, method + b" / HTTP/1.1\r\nHost: localhost:$\r\n\r\n")
        assert status == 501
        assert len(body) < 200


@pytest.mark.parametrize(
    ("head", "status"),
    [
        (b"GET /" + b"a" * 10_000 + b" HTTP/1.1\r\n", 414),
        (b"a" * 100_000, 414),
        (b"GET / HTTP/1.1\r\n" + b"A: b\r\n" * 5000, 431),
        (b"GET / HTTP/1.1\r\nHost: localhost:$\r\nCookie: " + b"c" * 100_000 + b"\r\n\r\n", 431),
        (b"GET / HTTP/1.1\r\n" + b"A: b\r\n" * 150 + b"\r\n", 431),
        (b"GET / HTTP/1.1\r\nHost: localhost:$\r\nContent-Length: 5\r\n\r\nhello", 413),
        (b"GET / HTTP/1.1\r\nHost: localhost:$\r\nContent-Length: 99999999999\r\n\r\n", 413),
        (b"GET / HTTP/1.1\r\nHost: localhost:$\r\nTransfer-Encoding: chunked\r\n\r\n", 413),
        (b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n", 400),
        (b"GET / HTTP/9.9\r\n\r\n", 505),
    ],
)
def test_what_is_too_large_or_no_request_is_refused_without_being_quoted(server, head, status):
    got, body = asked(server, head)
    assert got == status
    assert len(body) < 60
    assert get(server, OURS) == (200, PAGE)


def test_a_slow_request_ends_though_it_goes_on_sending(server, monkeypatch):
    monkeypatch.setattr(serve, "READ_S", 0.5)
    begin = time.monotonic()
    with connected(server) as s:
        s.settimeout(0.1)
        got = b""
        while not got and time.monotonic() < begin + 10.0:
            try:
                s.sendall(b"a")
                got = s.recv(100)
            except TimeoutError:
                continue
    assert got.startswith(b"HTTP/1.0 408 ")
    assert time.monotonic() - begin < 5.0


def test_a_client_that_does_not_read_is_left(monkeypatch):
    monkeypatch.setattr(serve, "WRITE_S", 0.3)
    with serving({"/": Answer(b"x" * 50_000_000)}.get, 0) as running:
        Thread(target=running.serve_forever, args=(0.05,), daemon=True).start()
        with connected(running) as s:
            s.sendall(f"GET / HTTP/1.1\r\nHost: localhost:{running.server_port}\r\n\r\n".encode())
            time.sleep(1.5)
            assert len(everything(s)) < 50_000_000
        running.shutdown()


def test_connections_beyond_the_cap_are_turned_away_and_room_comes_back(server):
    idle = [socket.create_connection((HOST, server.server_port), timeout=10.0) for _ in range(serve.CONNECTIONS)]
    time.sleep(0.5)
    with connected(server) as s:
        assert everything(s).startswith(b"HTTP/1.0 503 ")
    for s in idle:
        s.close()
    time.sleep(0.5)
    assert get(server, OURS) == (200, PAGE)


def test_answers_do_not_go_into_frames_or_caches(server):
    with connected(server) as s:
        s.sendall(f"GET / HTTP/1.1\r\nHost: localhost:{server.server_port}\r\n\r\n".encode())
        head = everything(s).partition(b"\r\n\r\n")[0].decode()
    for line in ("X-Frame-Options: SAMEORIGIN", "Cache-Control: no-store", "X-Content-Type-Options: nosniff"):
        assert line in head
    assert "Python" not in head
