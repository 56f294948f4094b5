"""The command ``testbench compatibility``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from testbench.core.constants import G0_M_S2
from testbench.page.terminal import console, stages
from testbench.questions.options import DataOption, OutOption, StrictOption, with_figures


@with_figures
def command(
    description: Annotated[
        Path,
        typer.Argument(help="Description of recorded flights (TOML), or a log, which is imported.", show_default=False),
    ],
    out: OutOption = Path("results"),
    data: DataOption = None,
    gravity: Annotated[float, typer.Option(help="Local gravity, m/s2.")] = G0_M_S2,
    strict: StrictOption = False,
) -> None:
    """Test whether the instruments of recorded flights agree with each other, and estimate the error of each.

    The answer names the instrument to check first, its error with a probability, and the measurement that would decide.
    The command integrates rates and accelerations and compares them with airspeed, flow angles, attitude and height,
    and with the speed over ground. It estimates biases, scales, clocks, lags, places and the wind as far as the data
    determine them, and writes the corrected records. Example: `testbench compatibility records/attas_full`, `testbench
    compatibility flight.csv`.
    """
    from testbench.core.store import ResultFolder, folder_in
    from testbench.logs.plausible import questions_of
    from testbench.logs.read import read_records
    from testbench.questions.compatibility.ask import compatibility
    from testbench.questions.compatibility.page import compatibility_page
    from testbench.questions.files import find
    from testbench.questions.identify.logs import descriptions_of
    from testbench.questions.identify.scenario import RecordDescription

    files = descriptions_of(description, out) if description.is_file() else [find(description, "identify")]
    for file in files:
        described = RecordDescription.load(file)
        with ResultFolder(folder_in(out, f"{described.name}_compatibility")) as place, stages() as say:
            say("read records")
            records = {name: record for name, _, record in read_records(described, data)}
            questions = questions_of(records.items(), described.file, strict)
            say("compare the instruments with one another")
            page = compatibility_page(compatibility(list(records.values()), gravity), records, described, questions)
            say("write report")
            page.write(place)
        page.show(console(), place.path)
