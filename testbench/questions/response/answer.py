"""Measured frequency responses in sentences: where they may be believed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from testbench.estimators.frequency.response import COHERENT, USABLE
from testbench.page.labels import number, symbol
from testbench.page.words import Answer, advice_lines

if TYPE_CHECKING:
    from testbench.estimators.frequency.response import FrequencyResponse


def response_answer(response: FrequencyResponse) -> Answer:
    """Return where each output's response is usable, with its errors, in sentences."""
    out: list[str] = []
    w = response.omega_rad_s
    for i, output in enumerate(response.outputs):
        good = (response.coherence[:, i] >= COHERENT) & response.usable[:, i].any(axis=1)
        if not good.any():
            said = "nowhere usable"
            if not (response.coherence[:, i] >= COHERENT).any():
                said = f"nowhere coherent with {', '.join(map(symbol, response.inputs))}"
            out.append(f"{symbol(output)}: {said}")
            continue
        runs = np.split(np.flatnonzero(good), np.flatnonzero(np.diff(np.flatnonzero(good)) > 1) + 1)
        longest = max(runs, key=lambda run: float(w[run[-1]] / w[run[0]]))  # in octaves, as responses are read
        error = 100.0 * float(np.median(response.random_error[longest, i].min(axis=1)))
        said = (
            f"{symbol(output)}: usable (coherence of at least {COHERENT:g}, error of at most {100 * USABLE:g} %) from "
            f"{number(float(w[longest[0]]))} to {number(float(w[longest[-1]]))} rad/s, with a random error of "
            f"{number(error, 2)} %"
        )
        if response.window_allowance is not None:
            windows = 100.0 * float(np.median(response.window_allowance[longest, i].min(axis=1)))
            said += f" and up to {number(windows, 2)} % from the windows"
        out.append(f"{said} (medians)")
    return [*out, *advice_lines(response.advice)]
