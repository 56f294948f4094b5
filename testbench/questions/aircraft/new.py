"""The command ``testbench aircraft new``: an aircraft of your own from its geometry."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from testbench.core.constants import DEG_RAD, PERCENT
from testbench.core.errors import ScenarioError
from testbench.core.store import ResultFolder
from testbench.page.page import COMPUTED, Page
from testbench.page.tables import Column, Table
from testbench.page.terminal import console, stages

if TYPE_CHECKING:
    from testbench.aircraft import Aircraft
    from testbench.aircraft.geometry.build import Made

_REPORT = "from_geometry"


def new(
    plan: Annotated[
        Path,
        typer.Argument(
            help="geometry.toml, a file of AVL (.avl), a plane of xflr5 (.xml), or DATCOM's for005 or for006.",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder of the aircraft; aircraft/NAME if not given.")
    ] = None,
    mass: Annotated[
        Path | None,
        typer.Option(
            help="With a file of AVL, xflr5 or DATCOM: a TOML file with the data that it lacks (mass, speed, throws)."
        ),
    ] = None,
) -> None:
    """Make an aircraft from its geometry: a JSBSim model, its limits, and how well each coefficient is known.

    Example: `testbench aircraft new geometry.toml -o aircraft/mine`, then `testbench aircraft aircraft/mine`.
    """
    from testbench.aircraft.geometry.aerodynamics import aerosandbox
    from testbench.aircraft.geometry.build import model_from_plan
    from testbench.aircraft.geometry.read import read_plan
    from testbench.flight import load_aircraft

    folder = out if out is not None else Path("aircraft") / default_name(plan)
    check_name(folder)
    with stages() as say, ResultFolder(folder) as place:
        place.check("aircraft.toml")
        say("read the plan")
        read = read_plan(plan, mass)
        aerosandbox()
        say("compute coefficients by strips and by a vortex lattice")
        made = model_from_plan(read, folder.name)
        say("write the aircraft")
        made.write(place.new)
        page = new_page(made, load_aircraft(place.new))
        page.write(place.new / _REPORT)
    page.show(console(), folder / _REPORT)
    print(f"Aircraft: {folder}")
    print(f"Next: testbench aircraft {folder}")


def default_name(plan: Path) -> str:
    """Return the name of an aircraft after its plan: that of the file, or of its folder for geometry.toml."""
    return plan.resolve().parent.name if plan.stem == "geometry" else plan.stem


def check_name(folder: Path) -> None:
    """Refuse a folder whose name cannot name a model.

    Raises:
        ScenarioError: it holds other characters than letters, digits, "_", "-" and ".".
    """
    name = folder.name
    if not name or not name.replace("_", "").replace("-", "").replace(".", "").isalnum() or not name.isascii():
        raise ScenarioError(
            f"an aircraft's name must be of letters, digits, '_', '-' and '.', got '{name}': give -o aircraft/NAME"
        )


def new_page(made: Made, aircraft: Aircraft) -> Page:
    """Return the page of an aircraft that was made from its geometry: three views, coefficients, remarks."""
    from testbench.questions.aircraft.three_view_figures import outline_plates

    table = coefficient_table(made)
    return Page(
        kicker=f"Aircraft from its geometry: {made.name}",
        title=made.plan.title,
        heading="In short",
        answer=new_answer(made),
        tables=[table],
        plates=outline_plates(aircraft),
        packages=(*COMPUTED, "aerosandbox"),
        terminal=[table.without("what", "why")],
    )


def new_answer(made: Made) -> list[str]:
    """Return in sentences what was made and what to mind."""
    plane, b = made.plan.plane, made.plan.balance
    values, found = made.coefficients, made.found
    margin = -values["Cm_alpha"].used / values["CL_alpha"].used / PERCENT
    doubt = values["Cm_alpha"].deviation * abs(margin)
    badly = [c.name for c in values.values() if c.apart]
    out = [
        f"{b.mass_kg:.4g} kg, wing area {plane.S_m2:.4g} m², span {plane.b_m:.4g} m, mean chord {plane.cbar_m:.4g} m",
        f"at {made.plan.said.design_V_m_s:g} m/s it flies at {found.alpha_rad / DEG_RAD:.1f} deg of alpha with "
        "a lift coefficient of "
        f"{found.CL:.2f}; the static margin is {margin:.0f} ± {doubt:.0f} % of the mean chord",
    ]
    if badly:
        out.append(f"the two methods differ by more than the deviation in {', '.join(badly)}")
    return [*out, *made.remarks]


def coefficient_table(made: Made) -> Table:
    """Return both methods' coefficients, the values used, and their deviations."""
    from testbench.aircraft.geometry.coefficients import ROWS

    stated = made.plan.stated.at(made.found.CL) if made.plan.stated is not None else {}
    columns = (
        Column("coefficient", "coefficient", get="name"),
        Column("what", "what", get=lambda c: ROWS[c.name].words),
        Column("build_up", "build-up", digits=4, get="buildup"),
        Column("lattice", "lattice", digits=4),
        *([Column("datcom", "DATCOM", digits=4, get=lambda c: stated.get(c.name))] if stated else []),
        Column("used", "used", digits=4),
        Column("deviation", "deviation", "%", decimals=0, get=lambda c: c.deviation / PERCENT),
        Column("why", "whose value, and why"),
    )
    caption = (
        "Per rad; rates as p b/2V, q c̄/2V, r b/2V, alphadot c̄/2V; moments about the centre of gravity. CD at the "
        "trimmed alpha. Deviation: relative, one standard deviation, from the difference of the two methods or a "
        "judged floor."
        + (" DATCOM: what its output tables at this lift coefficient, about its own moment centre." if stated else "")
    )
    title, found = "Coefficients by both methods", made.coefficients.values()
    return Table.of("coefficients", title, caption, columns, found, wide=True)
