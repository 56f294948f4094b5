"""Every value of measured frequency responses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from testbench.page.tables import Column, Table, Value

if TYPE_CHECKING:
    from testbench.estimators.frequency.response import FrequencyResponse


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
        "SI units and radians. Coherence is partial: what the other inputs explain is removed. By the windows: how far "
        "they can have moved the value, computed by a law that answers the recorded inputs."
    )
    return Table("frequency_response", "Frequency responses", caption, columns, tuple(rows))
