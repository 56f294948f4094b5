"""The command ``testbench sitl``."""

from __future__ import annotations

import math
from enum import Enum
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from testbench.page.terminal import console, stages
from testbench.questions.options import OutOption, UsageError


class Autopilot(str, Enum):
    """Whose simulator is served."""

    ardupilot = "ardupilot"
    px4 = "px4"


_without = partial(typer.Option, show_default=False)


def command(
    aircraft: Annotated[
        str, typer.Argument(help="Packaged, your own, amended, or of JSBSim (jsbsim:c172p).", show_default=False)
    ],
    to: Annotated[Autopilot, typer.Option(help="Whose simulator asks for physics.")] = Autopilot.ardupilot,
    sensors: Annotated[str | None, _without(help="Suite whose faults and noise the autopilot gets.")] = None,
    speed: Annotated[float | None, _without(min=0.1, help="True airspeed at the start, m/s. Default: design.")] = None,
    height: Annotated[
        float | None, _without(min=0.0, max=11000.0, help="Above sea level at the start, m. Default: design.")
    ] = None,
    wind: Annotated[str | None, _without(help="Steady, m/s, where it blows to: north,east or north,east,down.")] = None,
    ground: Annotated[
        float | None, _without(help="Its height above sea level, m. Default: 100 m below the start.")
    ] = None,
    release: Annotated[float, typer.Option(min=0.0, help="Trim is flown for so long before commands act, s.")] = 30.0,
    parameters: Annotated[
        Path | None, _without(help="Parameter file of the autopilot: which output drives what, ends, direction.")
    ] = None,
    throw: Annotated[
        list[str] | None, _without(help="Deflection at full command, deg, e.g. de=20; de=-20 turns it round.")
    ] = None,
    rate: Annotated[float | None, _without(min=20.0, max=4000.0, help="Steps a second. Default: its own.")] = None,
    port: Annotated[int | None, _without(min=1, max=65535, help="Default: 9002, ArduPilot; 4560, PX4.")] = None,
    address: Annotated[str, typer.Option(help="Where to listen; 0.0.0.0 for other machines.")] = "127.0.0.1",
    pace: Annotated[
        float, typer.Option(min=0.01, help="Of PX4's clock over ours; ArduPilot keeps its own (SIM_SPEEDUP).")
    ] = 1.0,
    idle: Annotated[
        float | None, _without(min=0.1, help="End when the autopilot is silent for so long, s; else at Ctrl-C.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the noise of the sensors.")] = 0,
    out: OutOption = Path("results"),
) -> None:
    """Serve an aircraft to an autopilot's own simulator, so that it flies the day's script before the day.

    ArduPilot by its JSON interface, PX4 by its simulator MAVLink in lockstep. Each flight begins at a trim in the air,
    and is recorded. Examples: `testbench sitl taurus --sensors my_autopilot`, then
    `sim_vehicle.py -v ArduPlane --model JSON:127.0.0.1`; `testbench sitl mine --to px4`.
    """
    from testbench.core.store import ResultFolder, folder_in
    from testbench.flight import load_aircraft
    from testbench.questions.importing.ask import parse_throws
    from testbench.questions.sitl.ask import Served, trim_for
    from testbench.questions.sitl.links import PORTS, serve
    from testbench.questions.sitl.outputs import Outputs, read_settings
    from testbench.questions.sitl.page import STAND_INS, sitl_page
    from testbench.sensors import load_suite

    flown = load_aircraft(aircraft)
    suite = None if sensors is None else load_suite(sensors)
    settings = {} if parameters is None else read_settings(parameters)
    outputs = Outputs(flown, to.value, settings, parse_throws(throw or []))
    trimmed = trim_for(flown, speed, height, _wind(wind), suite, rate)
    served = Served(flown, trimmed, suite, seed, release, ground)
    where = port or PORTS[to.value]
    with ResultFolder(folder_in(out, f"sitl_{flown.name}")) as place:
        with stages() as say:
            say(
                f"{flown.name} at {trimmed.condition}, {trimmed.rate_hz:g} steps a second, {served.ground_m:g} m above "
                f"sea level is the ground; it flies its trim for {release:g} s before commands act"
            )
            for name in trimmed.controls:
                say(f"{name}: {outputs.said.get(name, 'no output drives it, it stays at its trim')}")
            say(STAND_INS)
            try:
                serve(served, outputs, to.value, (address, where), idle or math.inf, say, pace)
            except KeyboardInterrupt:
                if not (
                    served.frames or served.tally.flights
                ):  # nothing was flown: no flight to keep, no autopilot to miss
                    raise
                say("ended by hand")
        served.end()
        if not served.tally.flights:
            from testbench.core.errors import RecordError

            raise RecordError(
                f"an autopilot must ask for physics at {address}, port {where}, but none did; start "
                + ("PX4 with PX4_SIM_HOSTNAME and no simulator of its own" if to is Autopilot.px4 else
                   f"ArduPilot with --model JSON:{address}")
            )  # fmt: skip
        page = sitl_page(served, "PX4" if to is Autopilot.px4 else "ArduPilot")
        page.write(place)
    page.show(console(), place.path)


def _wind(text: str | None) -> tuple[float, float, float]:
    """Return the velocity of the air north, east, down, m/s, from a text such as "3,-2"."""
    try:
        parts = [float(x) for x in (text or "0,0").split(",")]
    except ValueError:
        parts = []
    if len(parts) not in (2, 3) or not all(abs(x) < 100.0 for x in parts):
        raise UsageError(f"--wind must be two or three numbers, m/s, as 3,-2 or 3,-2,0.5, got '{text}'")
    return parts[0], parts[1], parts[2] if len(parts) > 2 else 0.0
