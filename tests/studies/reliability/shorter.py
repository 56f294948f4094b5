"""Less work of the same kind: fewer speeds, designs and heights, so that a case takes about a second of processor.

Each is called in the process before the command, see :class:`studies.reliability.small.Case`. What is read, which
files are written and in which order is left as it is.
"""

import fcntl
import importlib
import socket
import threading
from typing import Any


def few_sections() -> None:
    """Leave of the reproductions one section."""
    from testbench.questions.reproduce import ask, paper_checks

    title, rests_on, _ = ask.CHAPTERS["b1"]
    ask.CHAPTERS["b1"] = (title, rests_on, (paper_checks.eolo,))


def few_speeds() -> None:
    """Follow the modes of an aircraft over few speeds."""
    _set("evaluation.envelope", _SCAN=5, _INTERVALS=6)
    _set("questions.aircraft.ask", _SCAN=5, _INTERVALS=6)


def few_designs() -> None:
    """Search few designs, with few blocks and starts, and fly two."""
    _set("questions.design.ask", _FLOWN=2, _CLASSICS=("doublet",))
    _set("design.refine", BLOCKS=8, _RANDOM_STARTS=1, _POWER_ROUNDS=5, _ROUNDS=2, _BISECTIONS=3)
    _set("design.search", _REFINED=1, _UPPER=0.1)
    _set("design.amplitude", _ROUNDS=2, REALISED=1)


def one_height() -> None:
    """Look for turbulence of the height of the flight alone."""
    _set("questions.gap.evidence.air", _HEIGHTS_M=())


def an_autopilot() -> None:
    """Let a stand-in of ArduPilot fly what is served for a second, at a port of its own."""
    from questions.sitl.stand_ins import ArduPilot, free_port

    from testbench.questions.sitl import links

    links.PORTS["ardupilot"] = port = free_port()
    autopilot = ArduPilot(port)
    # Its socket must not take the number of a stream that is closed: it stands for another process.
    number = fcntl.fcntl(autopilot.link.detach(), fcntl.F_DUPFD_CLOEXEC, 64)
    autopilot.link = socket.socket(fileno=number)
    autopilot.link.settimeout(1.0)

    def fly() -> None:
        for _ in range(240):
            autopilot.step([1500, 1837, 1327, 1500])

    threading.Thread(target=fly, daemon=True).start()


def _set(module: str, **values: Any) -> None:
    found = importlib.import_module(f"testbench.{module}")
    for name, value in values.items():
        assert hasattr(found, name), f"testbench.{module} has no {name} any more"
        setattr(found, name, value)
