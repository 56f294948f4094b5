"""An aircraft's own deviations of its coefficients take the place of the general priors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from testbench.flight import load_aircraft
from testbench.questions.gap.priors import LATERAL_PRIORS, PRIORS, deviations_of
from testbench.questions.plan.response import relative_spread

OWN = replace(load_aircraft("taurus"), uncertainty={"Cm_alpha": 0.4, "Cn_r": 0.5, "CY_p": 0.9})


def test_own_numbers_replace_general_ones_and_add_no_nuisance():
    plain = load_aircraft("taurus")
    assert not plain.uncertainty
    assert deviations_of(plain) == {**PRIORS, **LATERAL_PRIORS}
    assert deviations_of(plain, PRIORS) is PRIORS
    found = deviations_of(OWN)
    assert (found["Cm_alpha"], found["Cn_r"], found["Cm_q"]) == (0.4, 0.5, PRIORS["Cm_q"])
    assert list(found) == [*PRIORS, *LATERAL_PRIORS]
    assert deviations_of(OWN, PRIORS) == {**PRIORS, "Cm_alpha": 0.4}


def test_a_hypothesis_starts_from_them():
    from testbench.core.record import FlightRecord
    from testbench.questions.gap.priors import priors_of

    t = np.arange(40) * 0.1
    channels = ("de_cmd", "da_cmd", "dr_cmd")
    still = FlightRecord(t, channels, np.zeros((40, 3)), "measured")
    assert priors_of([still], OWN)["Cm_alpha"] == 0.4
    assert priors_of([still]) is PRIORS


def test_the_band_of_a_plan_takes_the_coefficient_behind_each_derivative():
    found = relative_spread(("M_alpha", "M_q", "N_r", "Y_p", "X_alpha"), OWN, 0.15)
    np.testing.assert_array_equal(found, [0.4, 0.15, 0.5, 0.9, 0.15])
