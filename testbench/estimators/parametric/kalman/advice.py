"""What is doubtful about estimates of a Kalman filter, in words."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from testbench.core.advice import doubt, wrong
from testbench.core.constants import WHITE
from testbench.core.words import with_error
from testbench.estimators.coverage import approximate
from testbench.estimators.parametric.structure import LinearStructure

_VAGUE = 0.5  # standard error relative to the value
_LITTLE = 0.5  # share of the initial standard deviation that is left where the data say little
_NIS = 1.5  # innovations that are larger or smaller than their covariance by this factor in standard deviation


def advise_filter(model: Any) -> Any:
    """Return the ParametricModel of a Kalman filter with advice on what is doubtful.

    How often intervals held the truth is said where that may differ from 95 %: not of linear equations with innovations
    that are white and of the size that the filter expects.
    """
    found, out = model.diagnostics, []
    names = [p.name for p in model.structure.parameters if p.free]
    values, errors = model.params[model.structure.free], np.sqrt(np.diag(model.covariance))[model.structure.free]
    vague = [
        f"{n} {with_error(float(v), float(e))}"
        for n, v, e, start in zip(names, values, errors, found["initial_std"], strict=True)
        if e > _LITTLE * start and e > _VAGUE * abs(v)
    ]
    if vague:
        out.append(
            doubt(
                "weakly_identifiable",
                f"these data say little about {', '.join(vague)}: fix them at a believed value, or excite them more",
            )
        )
    outside = [
        p.name
        for p, v in zip(model.structure.parameters, model.params, strict=True)
        if p.free and not p.low <= v <= p.high
    ]
    if outside:
        out.append(
            wrong(
                "outside_bounds",
                f"{', '.join(outside)} ended outside the bounds, because a Kalman filter does not keep them; estimate "
                "by output or filter error, or start nearer with a smaller initial deviation",
            )
        )
    sizes = np.sqrt(found["normalised_innovations"])
    off = [f"{o} ({s:.2g})" for o, s in zip(model.outputs, sizes, strict=True) if s > _NIS or s * _NIS < 1.0]
    if off:
        out.append(
            doubt(
                "innovation_size",
                "the innovations do not have the size that the filter expects (measured over expected deviation): "
                f"{', '.join(off)}; its standard errors are off by about as much; correct measurement_noise or "
                "process_noise",
            )
        )
    coloured = [o for o, p in zip(model.outputs, found["whiteness_p"], strict=True) if p < WHITE]
    if coloured:
        out.append(
            doubt(
                "coloured_residuals",
                f"the innovations of {', '.join(coloured)} are not white: process noise, filtered measurements or "
                "something missing in the model; standard errors are too small",
            )
        )
    if off or coloured or not isinstance(model.structure, LinearStructure):
        out.extend(approximate(model.method))
    return replace(model, advice=tuple(out))
