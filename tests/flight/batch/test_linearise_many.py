"""Linear models by the batch are those that JSBSim's own differences give, bending and lag of the air included."""

from __future__ import annotations

import numpy as np

from testbench.flight import linearise
from testbench.flight.batch.linear import linearise_many


def test_an_elastic_aircraft_is_linearised_in_a_block_as_by_jsbsim(eolo, eolo_trim):
    (model,) = linearise_many([eolo], [eolo_trim], "batch")
    alone = linearise(eolo, eolo_trim)
    assert (model.states, model.inputs, model.outputs) == (alone.states, alone.inputs, alone.outputs)
    assert sum(name.startswith("eta_") for name in model.states) == len(eolo.elastic.modes)
    for matrix in "ABCD":
        got, right = getattr(model, matrix), getattr(alone, matrix)
        np.testing.assert_allclose(got, right, rtol=0.0, atol=1e-8 * (1.0 + np.max(np.abs(right))))
