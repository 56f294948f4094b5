"""Records that a pilot flew by hand: no trim at their start, commands that never rest."""

from __future__ import annotations

import numpy as np

from testbench.core.constants import DEG_RAD
from testbench.core.record import FlightRecord
from testbench.flight import trim
from testbench.flight.step import SteppedFlight
from testbench.questions.gap.believed import Believed


def hand_flown(truth: Believed, seed: int, duration_s: float, cut_s: float = 2.0, gains=(0.6, 0.15)) -> FlightRecord:
    """Fly ``truth`` by hand and return what its sensors read after ``cut_s``.

    The pilot holds a pitch angle that he changes at random every one to two seconds, with the elevator, and moves the
    throttle at random. Positive elevator pitches the nose down.
    """
    rng = np.random.default_rng(seed)
    trimmed, rate = trim(truth.aircraft, truth.condition, truth.rate_hz), truth.suite.rate_hz
    channels = tuple(dict.fromkeys((*truth.needed, "theta", "q", "de_cmd", "thr_cmd")))
    flight = SteppedFlight(truth.aircraft, trimmed, ("de", "thr"), channels, truth.rate_hz)
    now, rows, wanted, power, until = flight.read(), [], 0.0, 0.0, 0
    theta, q = channels.index("theta"), channels.index("q")
    for k in range(round(duration_s * rate)):
        if k == until:
            wanted, power = rng.uniform(-5.0, 5.0) * DEG_RAD, rng.uniform(-0.1, 0.1)
            until = k + int(rng.integers(rate, 2 * rate))
        error = now[theta] - trimmed.theta - wanted
        de = np.clip(gains[0] * error + gains[1] * now[q], -0.12, 0.12)
        # A flight by steps is that of the same signal one frame later: so are the samples of its record.
        first, *_, now = flight.advance(
            np.array([trimmed.controls["de"] + de, trimmed.controls["thr"] + power]), round(truth.rate_hz / rate)
        )
        rows.append(first)
    record = FlightRecord(
        np.arange(len(rows)) / rate, channels, np.array(rows), "truth", provenance={"manoeuvre": "by hand"}
    )
    return truth.suite.measure(record, seed).between(cut_s, duration_s)
