"""The page of measured frequency responses: their table, and one figure per output and input."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.estimators.frequency.response import COHERENT, USABLE
from testbench.page.figure import COLOURS, DOTTED, Chart, Curve, Panel, Plate, Rule, Span, bode, unwrapped
from testbench.page.labels import file_stem, ratio_unit, symbol
from testbench.page.page import COMPUTED, Page, source_of
from testbench.page.tables import Column, Table, Value
from testbench.questions.response.answer import response_answer

if TYPE_CHECKING:
    from testbench.core.record import FloatArray
    from testbench.estimators.frequency.response import FrequencyResponse
    from testbench.questions.identify.scenario import RecordDescription


def response_page(response: FrequencyResponse, description: RecordDescription) -> Page:
    """Return the page of the frequency responses of recorded flights; their long table is only in a file."""
    return Page(
        kicker=f"Frequency responses: {description.name}",
        title=description.title,
        answer=response_answer(response),
        more_tables=[response_table(response)],
        plates=response_plates(response),
        packages=COMPUTED,
        source=source_of(description),
    )


# --- tables -----------------------------------------------------------------------------------------------------------


def response_table(response: FrequencyResponse) -> Table:
    """Return every value of every response with coherence and errors."""
    columns = (
        Column("response", "response"),
        Column("omega", "ω", "rad/s", digits=4),
        Column("magnitude", "magnitude", digits=4),
        Column("phase", "phase", "deg", decimals=1),
        Column("coherence", "coherence", decimals=3),
        Column("random_error", "random error", "%", decimals=1),
        Column("windows", "by the windows", "%", decimals=1),
        Column("usable", "usable"),
        Column("averages", "averages", decimals=1),
    )
    windows = response.window_allowance
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
                        None if windows is None else 100.0 * float(windows[k, i, j]),
                        "yes" if response.usable[k, i, j] else "no",
                        float(response.averages[k]),
                    )
                )
    caption = (
        "SI units and radians. Coherence is partial: what the other inputs explain is removed. By the windows: their "
        "possible change of the value, computed with a model of the response to the recorded inputs."
    )
    return Table("frequency_response", "Frequency responses", caption, columns, tuple(rows))


# --- figures ----------------------------------------------------------------------------------------------------------


def response_plates(response: FrequencyResponse) -> list[Plate]:
    """Return one figure per output and input."""
    return [_plate(response, i, j) for i in range(len(response.outputs)) for j in range(len(response.inputs))]


def _plate(response: FrequencyResponse, i: int, j: int) -> Plate:
    output, given = response.outputs[i], response.inputs[j]
    w, H, error = response.omega_rad_s, response.H[:, i, j], response.total_error[:, i, j]
    factor, unit = ratio_unit(output, given)
    name = f"{symbol(output)} / {symbol(given)}"
    caption = (
        f"Response of {symbol(output)} to {symbol(given)} with its error on either side: one standard deviation by "
        f"chance, and the allowance for the windows. Shaded: usable (coherence of at least {COHERENT:g}, error of at "
        f"most {100 * USABLE:g} %). The response outside that band is not reliable."
    )
    size, phase, spread = factor * np.abs(H), unwrapped(H), np.minimum(error, 1.0)
    look: dict[str, Any] = {"colour": COLOURS[0], "width": 1.4}
    magnitude, turn = (
        (size * np.maximum(1.0 - spread, 0.03), size * (1.0 + spread)),
        (phase - np.degrees(spread), phase + np.degrees(spread)),
    )
    usable = _stretches(w, response.usable[:, i, j])
    upper, middle = bode(name, unit, [(w, size, phase, look)], draws=usable, bands=(magnitude, turn))
    lower = Panel(
        draws=[*usable, Curve(x=w, y=response.partial_coherence[:, i, j], **look),
               Rule(at=COHERENT, of="y", dash=DOTTED)],
        title="coherence", x="frequency, rad/s", log_x=True, x_range=(w[0], w[-1]), y_range=(0.0, 1.02), tall_in=0.9,
    )  # fmt: skip
    chart = Chart([[upper], [middle], [lower]], share=0.75, share_x=True)
    return Plate(f"response_{file_stem(output)}_{file_stem(given)}", f"Frequency response {name}", caption, chart)


def _stretches(w: FloatArray, good: np.ndarray) -> list[Span]:
    """Return the stretches of frequencies (n,) that are ``good``."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], good.astype(int), [0]])))
    return [Span(low=float(w[a]), high=float(w[b - 1])) for a, b in edges.reshape(-1, 2)]
