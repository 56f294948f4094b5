"""The command ``testbench response``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from testbench.questions.options import DataOption, OutOption, answering, with_figures


@with_figures
def command(
    description: Annotated[Path, typer.Argument(help="Description of recorded flights (TOML).", show_default=False)],
    window: Annotated[
        list[float], typer.Option(help="Length of the windows, s; several are combined (composite windowing).")
    ] = [10.0],  # noqa: B006 (typer reads it, nothing changes it)
    out: OutOption = Path("results"),
    data: DataOption = None,
) -> None:
    """Estimate the frequency responses of recorded flights with coherence, random error and the bias of the windows.

    All records of the description are taken together; its identification table names inputs and outputs. The method is
    for sweeps and multisines. Example: `testbench response records/attas_short_period --window 5 --window 12`.
    """
    from testbench.core.named import obtain
    from testbench.logs.read import read_records
    from testbench.questions.identify.scenario import RecordDescription
    from testbench.questions.response.ask import frequency_responses
    from testbench.questions.response.page import response_page

    described = obtain(RecordDescription, description)
    with answering(out, f"{described.name}_response") as a:
        a.say("read records")
        records = [record for _, _, record in read_records(described, data)]
        a.say("estimate frequency responses")
        a.found = response_page(frequency_responses(described, records, window), described)
