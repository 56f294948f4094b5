"""The report on measured frequency responses: magnitude, phase and coherence with their random error."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from testbench.page.labels import file_stem, number, ratio_unit, symbol
from testbench.page.plot import BAND, COLOURS, QUIET, Plate, grid, label, log_axis, new_figure
from testbench.page.tables import Column, Table, Value
from testbench.page.write import PAGE, write_file, write_plates, write_tables
from testbench.questions.run.frequency_figures import steps_of_phase

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import Console

    from testbench.estimators.frequency.response import FrequencyResponse
    from testbench.questions.identify.scenario import RecordDescription

COHERENT = 0.6  # the usual bound of flight test below which a response is not believed (custom, from memory)


def response_answer(response: FrequencyResponse) -> list[str]:
    """Return where each output is coherent with the inputs, in sentences."""
    out = []
    w = response.omega_rad_s
    for i, output in enumerate(response.outputs):
        good = response.coherence[:, i] >= COHERENT
        if not good.any():
            out.append(f"{symbol(output)}: nowhere coherent with {', '.join(map(symbol, response.inputs))}")
            continue
        runs = np.split(np.flatnonzero(good), np.flatnonzero(np.diff(np.flatnonzero(good)) > 1) + 1)
        longest = max(runs, key=len)
        error = 100.0 * float(np.median(response.random_error[longest, i].max(axis=1)))
        out.append(
            f"{symbol(output)}: coherence of at least {COHERENT:g} from {number(float(w[longest[0]]))} to "
            f"{number(float(w[longest[-1]]))} rad/s, random error there {number(error, 2)} % (median)"
        )
    return [*out, *response.advice]


def response_table(response: FrequencyResponse) -> Table:
    """Return every value of every response with coherence and random error."""
    columns = (
        Column("response", "response"),
        Column("omega", "ω", "rad/s", digits=4),
        Column("magnitude", "magnitude", digits=4),
        Column("phase", "phase", "deg", decimals=1),
        Column("coherence", "coherence", decimals=3),
        Column("random_error", "random error", "%", decimals=1),
        Column("averages", "averages", decimals=1),
    )
    rows: list[tuple[Value, ...]] = []
    for i, output in enumerate(response.outputs):
        for j, given in enumerate(response.inputs):
            phase = np.degrees(np.unwrap(np.angle(response.H[:, i, j])))
            for k, w in enumerate(response.omega_rad_s):
                rows.append(
                    (
                        f"{output}/{given}",
                        float(w),
                        float(abs(response.H[k, i, j])),
                        float(phase[k]),
                        float(response.partial_coherence[k, i, j]),
                        100.0 * float(response.random_error[k, i, j]),
                        float(response.averages[k]),
                    )
                )
    caption = "SI units and radians. Coherence is partial: freed of what the other inputs explain."
    return Table("frequency_response", "Frequency responses", caption, columns, tuple(rows))


def write_response(response: FrequencyResponse, description: RecordDescription, folder: Path | str) -> list[Path]:
    """Write the table, figures and report.html; return the paths, the page last.

    Raises:
        RecordError: the folder cannot be written to.
    """
    from testbench.page.html import render

    folder = Path(folder)
    out = write_tables([response_table(response)], folder)
    plates = [_plate(response, i, j) for i in range(len(response.outputs)) for j in range(len(response.inputs))]
    paths, pictures = write_plates(plates, folder)
    page = render(
        "analysis.html.j2",
        kicker=f"Frequency responses: {description.name}",
        title=description.title,
        answer=response_answer(response),
        pictures=pictures,
        tables=[],
        source_name=description.file.name if description.file else "as given",
        source_text=description.file.read_text(encoding="utf-8") if description.file else "",
    )
    return [*out, *paths, write_file(folder / PAGE, page)]


def print_response(response: FrequencyResponse, console: Console, folder: Path | str) -> None:
    """Print the answer and where the files are."""
    from rich.table import Table as Grid
    from rich.text import Text

    answer = Grid.grid(padding=(0, 1))
    for sentence in response_answer(response):
        answer.add_row("-", Text(sentence[:1].upper() + sentence[1:] + ("" if sentence.endswith(".") else ".")))
    console.print(answer)
    console.print()
    console.print(Text(f"Report: {Path(folder) / PAGE}"), soft_wrap=True)


def _plate(response: FrequencyResponse, i: int, j: int) -> Plate:
    output, given = response.outputs[i], response.inputs[j]
    w, H, error = response.omega_rad_s, response.H[:, i, j], response.random_error[:, i, j]
    coherence = response.partial_coherence[:, i, j]
    factor, unit = ratio_unit(output, given)
    name = f"{symbol(output)} / {symbol(given)}"
    caption = (
        f"Response of {symbol(output)} to {symbol(given)} with one standard deviation of its random error on either "
        f"side; shaded where the coherence reaches {COHERENT:g}. Beyond that band the response is not to be believed."
    )

    def make(wide: bool) -> Figure:
        """Draw magnitude, phase and coherence below each other."""
        tall = [1.5, 1.3, 0.9]
        figure = new_figure(wide, 0.25 + sum(tall) + 2 * 0.4 + 0.5, 0.75)
        panels = grid(figure, 0.25, tall, [1.0], gap_in=0.4).ravel()
        magnitude, phase = factor * np.abs(H), np.degrees(np.unwrap(np.angle(H)))
        spread = np.minimum(error, 1.0)
        good = coherence >= COHERENT
        for axes in panels:
            axes.fill_between(w, 0, 1, where=good, transform=axes.get_xaxis_transform(), color=BAND, linewidth=0)
            log_axis(axes, "x", powers=False)
            axes.set_xlim(w[0], w[-1])
        panels[0].fill_between(
            w, magnitude * np.maximum(1.0 - spread, 0.03), magnitude * (1.0 + spread), color=COLOURS[0], alpha=0.25
        )
        panels[0].plot(w, magnitude, color=COLOURS[0], linewidth=1.4)
        log_axis(panels[0], "y", powers=True)
        degrees = np.degrees(spread)
        panels[1].fill_between(w, phase - degrees, phase + degrees, color=COLOURS[0], alpha=0.25, linewidth=0)
        panels[1].plot(w, phase, color=COLOURS[0], linewidth=1.4)
        panels[1].yaxis.set_major_locator(steps_of_phase(panels[1].get_ylim()))
        panels[2].plot(w, coherence, color=COLOURS[0], linewidth=1.4)
        panels[2].axhline(COHERENT, color=QUIET, linewidth=0.8, linestyle=":")
        panels[2].set_ylim(0.0, 1.02)
        label(panels[0], "", unit, f"{name}, magnitude")
        label(panels[1], "", "deg", f"{name}, phase")
        label(panels[2], "frequency, rad/s", "", "coherence")
        for axes in panels[:2]:
            axes.tick_params(labelbottom=False)
        return figure

    return Plate(f"response_{file_stem(output)}_{file_stem(given)}", f"Frequency response {name}", caption, make)
