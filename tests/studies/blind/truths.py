"""Hidden truths of the blind test: all their kinds, and how far off the believed coefficients are beside them.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py). The
names that a truth may rightly be given are strings, compared with what the workflow says only when a case is scored.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from studies.blind.kinds import Kind
from studies.blind.truths_of_library_form import LIBRARY_FORM
from studies.blind.truths_of_other_form import OTHER_FORM
from studies.blind.truths_unseen import UNSEEN

KINDS: Mapping[str, Kind] = {**LIBRARY_FORM, **OTHER_FORM, **UNSEEN}
# Standard deviations by which the believed coefficients are off in every case (the priors that the workflow states).
PARAMETER_ERRORS = {"CL_alpha": 0.05, "CD": 0.10, "Cm_alpha": 0.10, "Cm_q": 0.15, "Cm_de": 0.10}


def parameter_errors(rng: np.random.Generator) -> dict[str, float]:
    """Return a factor per coefficient: normal about 1, cut at two standard deviations."""
    return {n: 1.0 + s * float(np.clip(rng.standard_normal(), -2.0, 2.0)) for n, s in PARAMETER_ERRORS.items()}
