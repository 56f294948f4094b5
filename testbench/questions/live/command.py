"""The command ``testbench live``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from testbench.page.terminal import console, manner
from testbench.questions.options import BeginningOption, OutOption, UsageError, with_figures

if TYPE_CHECKING:
    from contextlib import ExitStack

    from rich.live import Live

    from testbench.questions.live.ask import Session, Update
    from testbench.questions.live.careful import Careful
    from testbench.questions.live.stream import Sample


@with_figures
def command(
    source: Annotated[
        str,
        typer.Argument(
            help="A log, udp:PORT or serial:DEVICE:BAUD with MAVLink, or a folder that this command wrote.",
            show_default=False,
        ),
    ],
    aircraft: Annotated[str | None, typer.Option(help="What is believed to fly.", show_default=False)] = None,
    plan: Annotated[
        Path | None, typer.Option(help="Plan file or name whose cards are flown.", show_default=False)
    ] = None,
    replay: Annotated[bool, typer.Option("--replay", help="Play a whole log, not one that grows.")] = False,
    speed: Annotated[
        float | None, typer.Option(min=0.01, help="Of a replay, over that of the flight; else at once.")
    ] = None,
    wanted: Annotated[
        float, typer.Option(min=0.1, max=100.0, help="Standard error of derivatives that is wanted, %.")
    ] = 10.0,
    throw: Annotated[
        list[str] | None, typer.Option(help="Deflection at full command, deg, e.g. de=20; the aircraft's if left out.")
    ] = None,
    servo: Annotated[
        list[str] | None, typer.Option(help="Servo output of a control of a MAVLink vehicle, e.g. de=2.")
    ] = None,
    idle: Annotated[float, typer.Option(min=0.0, help="A source that is silent for so long has ended, s.")] = 30.0,
    onboard: Annotated[
        Path | None, typer.Option(help="Telemetry log (.tlog) to write of all that MAVLink brings.", show_default=False)
    ] = None,
    view: Annotated[
        str | None,
        typer.Option(help="Serve a page at an address of this machine, as 192.168.1.10:8701.", show_default=False),
    ] = None,
    changes: Annotated[
        bool, typer.Option("--changes", help="Watch for what changes in flight, from its own beginning on.")
    ] = False,
    beginning: BeginningOption = 60.0,
    bell: Annotated[bool, typer.Option("--bell", help="Ring the bell of the terminal at every stop.")] = False,
    out: OutOption = Path("results"),
) -> None:  # fmt: skip
    """Follow a flight while it flies: derivatives with errors, and what is not as believed.

    Calls "you have it, next card 4", "stop: q is 0.6 of what was expected", limits and instruments that fail. Listens
    only: nothing is ever sent to the aircraft. All samples are recorded, and the folder can be followed again; on a
    companion computer `--onboard flight.tlog` keeps every message at its full rate, for `testbench import`. With --view
    a phone in the network of the ground station shows it large, at the address that is printed.
    Examples: `testbench live flight.csv --aircraft taurus`, `testbench live udp:14550 --plan mine.toml --servo de=2`.
    """
    from contextlib import ExitStack

    from testbench.core.named import obtain
    from testbench.core.store import ResultFolder, folder_in
    from testbench.flight import load_aircraft
    from testbench.questions.importing.ask import parse_throws
    from testbench.questions.live.ask import Session, fly_along
    from testbench.questions.live.page import live_page
    from testbench.questions.live.stream import RECORDING, line_of, open_source
    from testbench.questions.plan.ask import make_plan
    from testbench.questions.plan.scenario import PlanScenario

    if (aircraft is None) == (plan is None):
        raise UsageError("give either --aircraft or --plan, which names one")
    address = None if view is None else _address(view)
    made = None if plan is None else make_plan(obtain(PlanScenario, plan))
    flown = made.aircraft if made is not None else load_aircraft(aircraft or "")
    full = {c: control.full for c, control in flown.controls.items() if c != "thr"}
    if onboard is not None and (onboard.suffix != ".tlog" or not source.startswith(("udp:", "serial:"))):
        raise UsageError("--onboard names a telemetry log, FILE.tlog, and goes with udp:PORT or serial:DEVICE:BAUD")
    if onboard is not None and onboard.exists():
        raise UsageError(f"--onboard writes over no flight, and '{onboard}' is there: name another file")
    with ExitStack() as files, ExitStack() as shown:
        kept = None
        if onboard is not None:
            beside = files.enter_context(ResultFolder(onboard.parent, adds=True))
            kept = files.enter_context(beside.live(onboard.name).open("wb"))
        throws = {**full, **parse_throws(throw or [])}
        opened = open_source(source, throws, _servos(servo or []), speed, replay, idle, kept)
        session = Session(opened.name.replace(":", "_"), flown, made, beginning_s=beginning if changes else None)
        place = files.enter_context(ResultFolder(folder_in(out, f"live_{session.source}")))
        screen = _View(session, opened.radio, bell, shown, address)
        with place.live(RECORDING).open("w", encoding="utf-8") as file:

            def keep(sample: Sample | Careful) -> None:
                file.write(line_of(sample))

            try:
                for update in fly_along(opened, flown, made, wanted / 100.0, keep, session):
                    file.flush()
                    if kept is not None:
                        kept.flush()
                    screen.show(update)
            except KeyboardInterrupt:
                session.notes.append("ended by hand")
        shown.close()
        page = live_page(session)
        page.write(place)
    if screen.unheard is not None:
        raise screen.unheard
    page.show(console(), place.path)


def _servos(given: list[str]) -> dict[str, int]:
    """Return control -> servo output from texts such as "de=2"."""
    from testbench.core.channels import CONTROLS

    out = {}
    for text in given:
        name, _, number = text.partition("=")
        if name not in CONTROLS or not number.isdecimal() or not 1 <= int(number) <= 16:
            raise UsageError(f"a servo must be {', '.join(CONTROLS)} = an output from 1 to 16, as de=2, got '{text}'")
        out[name] = int(number)
    return out


def _address(given: str) -> tuple[str, int]:
    """Return address and port from a text such as "192.168.1.10:8701"."""
    from ipaddress import IPv4Address

    host, _, port = given.rpartition(":")
    try:
        address = IPv4Address(host)
        if address.is_unspecified or address.is_multicast or not port.isdecimal() or int(port) > 65535:
            raise ValueError
    except ValueError:
        raise UsageError(
            f"--view must be one address of this machine and a port, as 192.168.1.10:8701, got '{given}'; the address "
            "is that by which the phone reaches this machine"
        ) from None
    return host, int(port)


class _View:
    """What is seen while it flies: calls as they come, and what is known, in a terminal and on a page.

    A terminal shows it all the time; where output goes to a file, derivatives are printed where a run ends.
    """

    def __init__(
        self, session: Session, radio: bool, bell: bool, shown: ExitStack, address: tuple[str, int] | None
    ) -> None:
        from testbench.questions.live.glance import Glance, served

        self.session, self.radio, self.bell, self.begun = session, radio, bell, False
        self.quiet = manner().how in ("quiet", "json")
        self.active: tuple[str, ...] = ()
        self.unheard: BaseException | None = None  # what kept a call from being shown: the flight is still recorded
        self.screen = console()
        self.page: Glance | None = None
        self.live: Live | None = None
        if address is not None:
            self.page, home = shown.enter_context(served(session.source, *address))
            self._say(f"Open {home} in a browser; who has this address sees the flight.")
        if self.screen.is_terminal and not self.quiet:
            from rich.live import Live

            self.live = shown.enter_context(Live(console=self.screen, auto_refresh=False))

    def show(self, update: Update) -> None:
        from testbench.questions.live.answer import called, estimate_line, link_lines
        from testbench.questions.live.glance import glance, glance_table

        if self.page is not None or self.live is not None:
            now = glance(self.session, update)
            if self.page is not None:
                self.page.show(now)
            if self.live is not None:
                self.live.update(glance_table(now), refresh=True)
        if self.bell and any(c.kind in ("stop", "instrument", "change") for c in update.calls):
            self.screen.bell()
        if self.quiet:
            return
        if not self.begun:
            self.begun = True
            for line in link_lines(self.session.rates, self.session.told, self.radio):
                self._say(line)
        for call in update.calls:
            self._say(
                f"{update.t_s:8.1f} s  {called(call)}",
                "bold red" if call.kind not in ("enough", "run", "careful", "next") else "bold",
            )
        for plane in self.active if self.live is None else ():
            if plane not in update.active:
                for e in self.session.latest(plane):
                    if e.wanted:
                        self._say(f"{update.t_s:8.1f} s  {estimate_line(e)}")
        self.active = update.active

    def _say(self, text: str, style: str = "") -> None:
        if self.unheard is not None:
            return
        try:
            self.screen.print(text, style=style, highlight=False, soft_wrap=True)
        except (OSError, SystemExit) as error:  # rich ends the program at a pipe that nobody reads
            self.unheard = error
