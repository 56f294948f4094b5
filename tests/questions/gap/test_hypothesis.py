"""A hypothesis and its tangents at the edge of what can be trimmed."""

from __future__ import annotations

import numpy as np
import pytest
from studies.blind.run import believe

from testbench.core.errors import TrimError
from testbench.questions.gap.hidden.truth import Truth
from testbench.questions.gap.sealed.flights import fly_truth
from testbench.questions.gap.search.hypothesis import Hypothesis


def least_factor_with_trim(believed, low=0.4, high=1.0):
    """The smallest factor of Cm_de, to 1e-3, with which the throw of the elevator holds the aircraft in trim."""
    while high - low > 1e-3:
        middle = 0.5 * (low + high)
        try:
            _ = believed.with_nuisances({"Cm_de": middle}).trimmed
            high = middle
        except TrimError:
            low = middle
    return high


def test_where_one_side_has_no_trim_the_tangent_is_taken_to_the_other():
    believed = believe("taurus")
    records = tuple(fly_truth("taurus", Truth(), "short", 11).values())[:1]
    least = least_factor_with_trim(believed)
    names = list(Hypothesis.at(believed, believed, records).priors)
    k = names.index("Cm_de")
    edge, inside = (
        Hypothesis.at(believed, believed, records, np.where(np.arange(len(names)) == k, least + above, 1.0))
        for above in (0.005, 0.025)
    )
    with pytest.raises(TrimError):
        _ = believed.with_nuisances({"Cm_de": least + 0.005 - 0.02}).trimmed
    one_sided, central = edge.tangents[:, k], inside.tangents[:, k]
    assert np.linalg.norm(one_sided - central) < 0.1 * np.linalg.norm(central)
