"""Measured frequency responses in sentences: where they may be believed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from testbench.page.labels import number, symbol
from testbench.page.words import Answer, advice_lines

if TYPE_CHECKING:
    from testbench.estimators.frequency.response import FrequencyResponse

COHERENT = 0.6  # the usual bound of flight test below which a response is not believed (custom, from memory)


def response_answer(response: FrequencyResponse) -> Answer:
    """Return where each output is coherent with the inputs, in sentences."""
    out: list[str] = []
    w = response.omega_rad_s
    for i, output in enumerate(response.outputs):
        good = response.coherence[:, i] >= COHERENT
        if not good.any():
            out.append(f"{symbol(output)}: nowhere coherent with {', '.join(map(symbol, response.inputs))}")
            continue
        runs = np.split(np.flatnonzero(good), np.flatnonzero(np.diff(np.flatnonzero(good)) > 1) + 1)
        longest = max(runs, key=lambda run: float(w[run[-1]] / w[run[0]]))  # in octaves, as responses are read
        error = 100.0 * float(np.median(response.random_error[longest, i].max(axis=1)))
        out.append(
            f"{symbol(output)}: coherence of at least {COHERENT:g} from {number(float(w[longest[0]]))} to "
            f"{number(float(w[longest[-1]]))} rad/s, with a random error of {number(error, 2)} % (median)"
        )
    return [*out, *advice_lines(response.advice)]
