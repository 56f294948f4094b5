"""How far the noise of gyros and accelerometers makes the reconstruction drift over a record."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from testbench.core.advice import Advice, note
from testbench.core.constants import DEG_RAD
from testbench.estimators.compatibility.fit import Stretch
from testbench.estimators.parametric.kinematics import KinematicStructure
from testbench.estimators.regression.smoothing import white_std

_LONG = 3.0
_OF_RATE = {"p": "phi", "q": "theta", "r": "psi"}


def noise_std(stretches: Sequence[Stretch], column: int, of_inputs: bool = True) -> float:
    """Return the standard deviation of white noise in a column."""
    return white_std([(s.u if of_inputs else s.y)[:, column] for s in stretches])


def too_long(structure: KinematicStructure, stretches: Sequence[Stretch], dt_s: float) -> list[Advice]:
    """Return in words where records are long for output error, which takes rates and accelerations as exact.

    White noise of standard deviation s in the samples of a rate makes the angle drift by s sqrt(dt T) after T, and
    through gravity a velocity by g s sqrt(dt T^3 / 3). A record is called long if that exceeds three times the noise of
    the angle, or of the airspeed.
    """
    T = max(len(s.u) for s in stretches) * dt_s
    drifts = []
    for rate, angle in _OF_RATE.items():
        if rate not in structure.inputs:
            continue
        gyro = noise_std(stretches, structure.inputs.index(rate))
        pairs = [(angle, gyro * np.sqrt(dt_s * T), 1.0 / DEG_RAD, "deg")]
        if rate != "r":
            pairs.append(("V", structure.gravity_m_s2 * gyro * np.sqrt(dt_s * T**3 / 3.0), 1.0, "m/s"))
        for name, drift, factor, unit in pairs:
            if name not in structure.outputs:
                continue
            noise = noise_std(stretches, structure.outputs.index(name), False)
            if drift > _LONG * noise > 0.0:
                drifts.append(
                    f"that of {rate} moves {name} by {drift * factor:.2g} {unit} (noise of {name}: "
                    f"{noise * factor:.2g} {unit})"
                )
    if not drifts:
        return []
    said = (
        f"records of {T:.0f} s are long for output error, because noise of the rates adds up: {'; '.join(drifts)}; the "
        "standard errors allow for it, and shorter records would make them smaller"
    )
    return [note("long_records", said)]
