"""The command ``testbench modes``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from testbench.core.constants import PERCENT
from testbench.core.errors import RecordError
from testbench.questions.options import DataOption, OutOption, SeedOption, answering, refuse, with_figures


@with_figures
def command(
    context: typer.Context,
    source: Annotated[
        list[Path],
        typer.Argument(
            help="Records (NetCDF), a description of recorded flights, or a scenario of flight in turbulence (TOML).",
            show_default=False,
        ),
    ],
    channels: Annotated[
        list[str] | None,
        typer.Option(help="Channel to find modes in; may be repeated. All channels of the wing if none is given."),
    ] = None,
    references: Annotated[
        list[str] | None,
        typer.Option(help="Channel to correlate all others with; may be repeated. Every channel if none is given."),
    ] = None,
    band: Annotated[
        tuple[float, float] | None, typer.Option(help="Lowest and highest frequency, Hz.", show_default=False)
    ] = None,
    risk: Annotated[
        float | None,
        typer.Option(
            min=0.01,
            max=50.0,
            help="Probability of flutter up to the speed that is cleared, percent; 1 if not given.",
            show_default=False,
        ),
    ] = None,
    order: Annotated[int | None, typer.Option(help="Largest number of states, even; 40 if not given.")] = None,
    out: OutOption = Path("results"),
    data: DataOption = None,
    seed: SeedOption = None,
) -> None:
    """Find modes from outputs alone, such as the accelerometers of a wing in turbulence, without any input.

    The report gives frequencies, damping ratios and shapes with their errors, and a stabilisation diagram. For a
    simulated flight it compares them with the modes of the linearised aircraft. Records at two speeds or more also
    give the posterior of the flutter onset, and the next speed that is cleared at a stated risk. Examples: `testbench
    modes eolo_turbulence`, `testbench modes 12.nc 13.nc 14.nc --band 2 40 --risk 1`.
    """
    from testbench.core.paths import find_scenario
    from testbench.estimators.operational.onset import RISK
    from testbench.page.page import record_keeper
    from testbench.questions.files import find, kinds_of
    from testbench.questions.modes.ask import fly_modes, read_modes, search_for
    from testbench.questions.modes.scenario import ModesScenario

    asked = {"channels": channels, "references": references, "band_hz": band, "order": order}
    given = {key: value for key, value in asked.items() if value}
    at_most = RISK if risk is None else risk * PERCENT
    scenario = find_scenario(source[0])
    flown = source[0].suffix.lower() != ".nc"
    flown = flown and not (scenario.is_file() and kinds_of(scenario)[0].command == "identify")
    if flown:
        if len(source) > 1:
            raise RecordError(f"scenarios and descriptions must be given one at a time, got {len(source)} files")
        refuse(context, "with a scenario, which makes its own flights", "data")
        scenario = find(source[0], "modes")
    else:
        refuse(context, "with measured records, which hold their own noise", "seed")
    with answering(out, f"{scenario.stem}_modes") as a:
        if flown:
            loaded = ModesScenario.load(scenario)
            a.found = fly_modes(loaded, search_for(given, loaded.modes), seed, record_keeper(a.place), a.say, at_most)
        else:
            a.say("read records")
            a.found = read_modes(source, search_for(given), data, a.say, at_most)
