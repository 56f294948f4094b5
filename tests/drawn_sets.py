"""A small data set for tests, and a loader where PyTorch is missing."""

import numpy as np

SMALL = """
title = "Small"
flights = 60
seed = 5
licence = "CC0-1.0"
suite = "eolo_gap"
samples_hz = 50.0

[simulation]
rate_hz = 100.0

[[manoeuvre]]
name = "doublet"
duration_s = 3.0
settle_s = 1.0
input = [{ signal = "doublet", control = "de", start_s = 0.2, amplitude_deg = 1.0, period_s = 0.8 }]

[[manoeuvre]]
name = "3211"
duration_s = 4.0
settle_s = 1.0
input = [{ signal = "3211", control = "de", start_s = 0.2, amplitude_deg = 1.0, step_s = 0.3 }]

[[level]]
name = "clean"
aircraft = ["taurus"]
speed_ratio = [1.0, 1.2]
h_m = [100.0, 300.0]
noise = 0.0

[[level]]
name = "hidden"
aircraft = ["taurus", "eolo"]
speed_ratio = [1.05, 1.2]
h_m = [300.0, 500.0]
turbulence_rms_m_s = [0.1, 0.2]
hidden = ["transport_delay", "actuator_lag", "q_scale"]

[level.vary]
"coefficient.Cm_alpha" = { kind = "normal", mean = 1.0, std = 0.05 }
"""


class StandIn:
    """Batches of a map-style data set, collated as torch.utils.data.default_collate does arrays."""

    def __init__(self, data, batch_size, shuffle):
        order = np.random.default_rng(0).permutation(len(data)) if shuffle else np.arange(len(data))
        self._batches = [[data[i] for i in order[k : k + batch_size]] for k in range(0, len(order), batch_size)]

    def __iter__(self):
        return iter([tuple(np.stack(x) for x in zip(*batch, strict=True)) for batch in self._batches])
