"""What the test conductor sees at a glance while it flies: one word, what is known, what is next.

A page shows it to whoever has the address with its token, on this machine or on a phone in the network of the ground
station; a terminal shows the same. Nothing is taken from the page: it only asks what there is.
"""

from __future__ import annotations

import json
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any

from testbench.page.html import render
from testbench.page.serve import Answer, serving
from testbench.questions.live.answer import called, more

if TYPE_CHECKING:
    from rich.table import Table

    from testbench.questions.live.ask import Session, Update

_STOP_S, _SAID_S = 20.0, 8.0
"""How long a stop stands, and what else was called."""
_WORDS = {"stop": "STOP", "instrument": "STOP", "change": "STOP", "limit": "LIMIT", "enough": "YOU HAVE IT"}
_CALLS = 5
_SCRIPT = Path(__file__).resolve().parent / "glance.js"


def glance(session: Session, update: Update) -> dict[str, Any]:
    """Return what is shown after an update: ``word`` and its ``kind``, ``line``, ``derivatives``, ``calls``.

    Errors of derivatives, and those that are wanted, are in percent of the believed values.
    """
    t_s = update.t_s
    recent = [c for c in session.calls if t_s - c.t_s <= (_STOP_S if _WORDS.get(c.kind) == "STOP" else _SAID_S)]
    stops = [c for c in recent if _WORDS.get(c.kind) == "STOP"]
    call = next(reversed(stops or [c for c in recent if c.kind in _WORDS]), None)
    card = session.next_card
    if call is not None:
        kind, word, line = call.kind, _WORDS[call.kind], called(call)
    elif update.active:
        kind, word, line = "run", "FLY ON", f"a {' and '.join(update.active)} manoeuvre is being flown"
    elif not any(why == "" for why in session.told.values()):
        kind, word, line = "listen", "LISTEN", next(iter(session.told.values()), "the link is being measured")
    elif card is not None:
        kind, word, line = "next", f"CARD {card.number}", card.title
    elif session.plan is not None:
        kind, word, line = "enough", "LAND", "nothing is left to fly"
    else:
        kind, word, line = "listen", "READY", "begin a manoeuvre from steady flight"
    outlook = session.outlook
    derivatives = []
    for plane in ("longitudinal", "lateral"):
        for e in session.latest(plane):
            if e.wanted:
                size = max(abs(e.believed or e.value), 1e-12)
                error, wanted = 100.0 * e.std / size, 100.0 * e.wanted / size
                derivatives.append({"name": e.name, "error": round(error, 2), "wanted": round(wanted, 2),
                                    "reached": e.reached, "more": "" if e.reached else more(e.more_s)})  # fmt: skip
    return {
        "t_s": round(t_s, 1),
        "kind": {"instrument": "stop"}.get(kind, kind),
        "word": word,
        "line": line.partition(": ")[2] if word in ("STOP", "LIMIT", "YOU HAVE IT") else line,
        "left_s": None if outlook is None else round(outlook.left_s),
        "brings": "" if outlook is None else outlook.words,
        "derivatives": derivatives,
        "calls": [[round(c.t_s, 1), called(c)] for c in session.calls[-_CALLS:][::-1]],
        "stops": sum(_WORDS.get(c.kind) == "STOP" for c in session.calls),
    }


def glance_table(shown: dict[str, Any]) -> Table:
    """Return the same for a terminal."""
    from rich.table import Table
    from rich.text import Text

    style = {"stop": "bold white on red", "limit": "bold black on yellow", "enough": "bold black on green"}
    out = Table.grid(padding=(0, 2))
    word = Text(f" {shown['word']} ", style=style.get(shown["kind"], "bold reverse"))
    out.add_row(word, Text(f"{shown['t_s']:.1f} s   {shown['line']}"))
    if shown["left_s"] is not None:
        out.add_row(Text(f"{shown['left_s']} s left", style="bold"), Text(shown["brings"]))
    known = Table(box=None, padding=(0, 2))
    for head in ("derivative", "error", "wanted", ""):
        known.add_column(head, justify="left" if head in ("derivative", "") else "right")
    for d in shown["derivatives"]:
        known.add_row(
            d["name"], f"{d['error']:.2g} %", f"{d['wanted']:.2g} %", "as wanted" if d["reached"] else d["more"],
            style="green" if d["reached"] else "",
        )  # fmt: skip
    said = Text("\n".join(f"{t_s:8.1f} s  {words}" for t_s, words in shown["calls"]))
    out.add_row(known, said)
    return out


class Glance:
    """The page of a session while it flies.

    Attributes:
        home: its path, which begins with a token: who does not have it is told nothing.
    """

    def __init__(self, name: str) -> None:
        self.home = f"/{secrets.token_urlsafe(16)}/"
        self._page = render("questions/live/glance.html.j2", False, (_SCRIPT,), name=name).encode()
        self._now = b"null"

    def show(self, shown: dict[str, Any]) -> None:
        """Show what :func:`glance` returned."""
        self._now = json.dumps(shown, allow_nan=False).encode()

    def answer(self, path: str) -> Answer | None:
        """Return what is sent for a path; None for all that is not below ``home``."""
        if path == self.home:
            return Answer(self._page)
        return Answer(self._now, "application/json") if path == f"{self.home}now" else None


@contextmanager
def served(name: str, host: str, port: int) -> Iterator[tuple[Glance, str]]:
    """Serve the page of a session within the block; give it, and its address.

    Raises:
        LimitError: the address is not one of this machine, or the port is taken.
    """
    page = Glance(name)
    with serving(page.answer, port, host=host) as server:
        thread = Thread(target=server.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True)
        thread.start()
        try:
            yield page, f"http://{host}:{server.server_port}{page.home}"
        finally:
            server.shutdown()
            thread.join()
