"""An aircraft for other programs: as C, as a unit for co-simulation, and as plain JSBSim XML."""

from __future__ import annotations

from pathlib import Path

from testbench.aircraft import Aircraft
from testbench.core.errors import LimitError, nearest
from testbench.core.escape import c_identifier, markdown_cell
from testbench.core.files import write_file
from testbench.core.named import Named, obtain
from testbench.core.store import ResultFolder, folder_in
from testbench.flight import FlightCondition, trim
from testbench.flight.batch.alone import alone
from testbench.flight.batch.c99 import c_files
from testbench.flight.executive import Executive
from testbench.questions.export.fmu import fmu

TARGETS = ("c", "fmu2", "fmu3", "jsbsim")
"""What an aircraft is written as."""


def export_aircraft(
    aircraft: Named[Aircraft], to: str, folder: Path | str = "exports", condition: FlightCondition | None = None
) -> list[Path]:
    """Write an aircraft for other programs into a folder of its own in ``folder`` and return the paths.

    Args:
        aircraft: what is written; its folder has its name.
        to: "c" NAME.h and NAME.c, which fly from the trim; "fmu2", "fmu3" a unit for co-simulation by FMI 2.0 or 3.0,
            which does the same; "jsbsim" NAME.xml, Engines/ and README.md, a model that stock JSBSim loads from
            ``folder``: nothing is flown for it, so that an aircraft that does not trim can be looked at elsewhere.
        folder: in which it is written.
        condition: where it is trimmed, and for which the elastic equations are made; the design condition if not given.

    Raises:
        LimitError: it is not found equal to JSBSim in a batch, of which C and units are made.
        TrimError: it has no trim there.
        BusyError: another process writes into the folder.
        WriteError: the folder cannot be written to, or has such a file that the testbench did not write.

    Example:
        >>> import tempfile
        >>> import testbench as tb
        >>> [path.name for path in tb.export_aircraft("taurus", "c", tempfile.mkdtemp())]
        ['taurus.h', 'taurus.c']
    """
    if to not in TARGETS:
        raise LimitError(f"an aircraft goes to one of {', '.join(TARGETS)}, got '{to}'{nearest(to, TARGETS)}")
    aircraft = obtain(Aircraft, aircraft)
    condition = condition or FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m)
    name = aircraft.name.removesuffix(", rigid wings")
    files: dict[str, str | bytes]
    if to == "jsbsim":
        files = dict(_plain(aircraft, name, condition))
    else:
        model, stem = alone(aircraft, trim(aircraft, condition)), c_identifier(name)
        if to == "c":
            files = dict(zip((f"{stem}.h", f"{stem}.c"), c_files(model, name), strict=True))
        else:
            files = {f"{stem}_{to}.fmu": fmu(model, name, int(to[-1]))}
    with ResultFolder(folder_in(Path(folder), name), adds=True) as place:
        for file, content in files.items():
            place.check(file)
            write_file(place.new / file, content)
    return [place.path / file for file in files]


def _plain(aircraft: Aircraft, name: str, condition: FlightCondition) -> dict[str, str]:
    """Return the files of a plain model.

    The elastic equations are made for the condition and the aircraft's own frame rate. Of a foreign model README.md
    says how it is commanded and what it must be told.
    """
    rate = aircraft.rate_hz
    note = (
        f"# {markdown_cell(name)}\n\n{markdown_cell(aircraft.title)}. Plain JSBSim model, for the `aircraft/` folder "
        "of a JSBSim root directory.\n\n"
    )
    if aircraft.flown_modes() is not None:
        note += (
            f"The elastic equations are made for {rate:g} frames per second: set the frame time to 1/{rate:g} s before "
            f"the model is loaded, as any other gives wrong modes. They are exact at {condition}, and close at other "
            "speeds.\n"
        )
    else:
        note += f"The model has no elastic equations and flies at any frame rate; {rate:g} per second is its own.\n"
    return {
        f"{name}.xml": aircraft.model_xml(rate, condition.qbar_Pa, condition.V_m_s),
        **{f"Engines/{file}": text for file, text in aircraft.engine_files.items()},
        "README.md": note + _commands(aircraft, condition),
    }


def _commands(aircraft: Aircraft, condition: FlightCondition) -> str:
    """Return how a foreign model is commanded and what it must be told before it flies; empty for one of our form."""
    if aircraft.adapter is None:
        return ""
    rows = [f"- {c.name}: `{c.command}`, {'0 to 1' if c.name == 'thr' else 'rad'}" for c in aircraft.controls.values()]
    told = [f"- `{name}` = {value:g}" for name, value in aircraft.adapter.settings.items()]
    fdm = Executive(aircraft, aircraft.rate_hz, condition)
    pistons = fdm.has("propulsion/engine/map-pa")
    running = [f"- `{name}` = {value:.9g}" for name, value in fdm.leaned().items() if pistons]
    note = (
        "\nIts controls are commanded through these properties:\n\n" + "\n".join(rows) + "\n\nSet once it is loaded, "
        "before its engines are started (`propulsion/set-running` = -1):\n\n" + "\n".join(told) + "\n"
    )
    if running:
        leaned = f"\nSet once they run, as starting makes the mixture full rich; leaned for {condition.h_m:g} m:\n\n"
        note += leaned + "\n".join(running) + "\n"
    return note
