"""An aircraft as plain JSBSim XML, made for its design condition."""

from __future__ import annotations

from pathlib import Path

from testbench.aircraft import Aircraft
from testbench.core.escape import markdown_cell
from testbench.core.files import write_file
from testbench.core.store import ResultFolder, folder_in
from testbench.flight import FlightCondition
from testbench.flight.executive import Executive


def export_aircraft(aircraft: Aircraft, name: str, folder: Path | str) -> list[Path]:
    """Write NAME/NAME.xml, NAME/Engines/ and NAME/README.md: a model that stock JSBSim loads from ``folder``.

    The elastic equations are made for the design condition and the aircraft's own frame rate. Nothing is flown: the XML
    is made of the aircraft's own, so that an aircraft that does not trim can be looked at elsewhere. Of a foreign model
    README.md says how it is commanded and what it must be told.

    Raises:
        BusyError: another process writes into the folder.
        WriteError: the folder cannot be written to, or has such a file that the testbench did not write.
    """
    condition = FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m)
    rate = aircraft.rate_hz
    note = (
        f"# {markdown_cell(name)}\n\n{markdown_cell(aircraft.title)}. Plain JSBSim model, for the `aircraft/` folder "
    )
    note += "of a JSBSim root directory.\n\n"
    if aircraft.flown_modes() is not None:
        note += (
            f"The elastic equations are made for {rate:g} frames per second: set the frame time to 1/{rate:g} s before "
            f"the model is loaded, as any other gives wrong modes. They are exact at {condition}, and close at other "
            "speeds.\n"
        )
    else:
        note += f"The model has no elastic equations and flies at any frame rate; {rate:g} per second is its own.\n"
    note += _commands(aircraft, condition)
    with ResultFolder(folder_in(Path(folder), name)) as place:
        out = [write_file(place.new / f"{name}.xml", aircraft.model_xml(rate, condition.qbar_Pa, condition.V_m_s))]
        out += [write_file(place.new / "Engines" / file, text) for file, text in aircraft.engine_files.items()]
        out += [write_file(place.new / "README.md", note)]
    return [place.path / path.relative_to(place.new) for path in out]


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
