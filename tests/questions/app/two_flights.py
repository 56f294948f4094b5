"""Records of two flights in a folder of results, as the views of the app show them."""

import json
from pathlib import Path

import numpy as np

from testbench.core.record import FlightRecord

RECORD, OTHER = "results/first_log/whole.nc", "results/second/records/other.nc"
RATE_HZ, TONE_HZ = 50.0, 2.0


def write_results_of(folder: Path) -> tuple[FlightRecord, FlightRecord]:
    """Write a log of 40 s, of which q follows de, and a record of 30 s that begins later; return both."""
    rng = np.random.default_rng(1)
    t = np.arange(2000) / RATE_HZ
    de = 0.1 * np.sin(2.0 * np.pi * TONE_HZ * t) + 0.01 * rng.standard_normal(t.size)
    q = -2.0 * de + 1e-4 * rng.standard_normal(t.size)
    V = 20.0 + 0.0 * t
    valid = np.ones((t.size, 3), bool)
    valid[500:900, 2] = False  # eight seconds without airspeed
    first = FlightRecord(t, ("de", "q", "V"), np.stack([de, q, V], axis=1), "measured", valid)
    second = FlightRecord(t[:1500] + 100.0, ("de", "q"), np.stack([de, q], axis=1)[:1500], "measured")
    for path, record in ((RECORD, first), (OTHER, second)):
        (folder / path).parent.mkdir(parents=True)
        record.save(folder / path)
    said = {
        "log": "first.csv", "format": "table (csv)", "questions": [],
        "stretches": [
            {"start_s": 0.0, "end_s": 10.0, "kind": "parked", "mode": "", "why": "slow", "flown": False},
            {"start_s": 10.0, "end_s": 39.98, "kind": "cruise", "mode": "", "why": "", "flown": True},
        ],
        "manoeuvres": [{"controls": ["de"], "start_s": 15.0, "end_s": 20.0, "amplitude": [0.1], "cut_s": [13.0, 25.0],
                        "reason": ""}],
        "parameters": {"SAME": 1.0, "GAIN": 2.0},
    }  # fmt: skip
    (folder / RECORD).with_name("log.json").write_text(json.dumps(said), encoding="utf-8")
    return first, second
