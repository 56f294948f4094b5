"""Binary signals: every register runs through its whole period; binary noise switches as often as it says."""

import numpy as np
import pytest

from testbench.core.errors import ScenarioError
from testbench.core.scenario.inputs import BinaryNoise, Prbs
from testbench.inputs import build
from testbench.inputs.binary import binary_noise, prbs, prbs_bits

DE = {"control": "de", "amplitude_deg": 2.0}


@pytest.mark.parametrize("register", range(2, 17))
def test_a_sequence_has_maximal_length_and_the_correlation_of_one(register):
    length = 2**register - 1
    bits = prbs_bits(register, 1, 2 * length)
    np.testing.assert_array_equal(bits[:length], bits[length:])
    spectrum = np.fft.rfft(bits[:length])
    correlation = np.fft.irfft(np.abs(spectrum) ** 2, length) / length
    assert correlation[0] == pytest.approx(1.0)
    np.testing.assert_allclose(correlation[1:], -1.0 / length, atol=1e-10)  # so no shorter period fits into it


def test_prbs_is_clocked():
    spec = Prbs(signal="prbs", step_s=0.2, prbs_s=4.1, bits=5, seed=3, **DE)
    u = prbs(spec, 10.0, 50.0) / spec.amplitude
    np.testing.assert_array_equal(u[:200].reshape(20, 10), np.repeat(prbs_bits(5, 3, 20)[:, None], 10, axis=1))
    assert not u[200:].any(), "4.1 s hold 20 whole steps"


def test_binary_noise_switches_with_its_probability():
    spec = BinaryNoise(signal="gbn", step_s=0.1, gbn_s=1000.0, switching=0.3, seed=5, **DE)
    bits = (binary_noise(spec, 1000.0, 10.0) / spec.amplitude)[:10000]
    assert set(bits) == {-1.0, 1.0}
    switches = np.count_nonzero(np.diff(bits))
    # binomial, 9999 draws of 0.3: 4 standard deviations are 183; false alarm 6e-5
    assert abs(switches - 0.3 * 9999) < 183
    again = binary_noise(spec, 1000.0, 10.0)
    np.testing.assert_array_equal(again[:10000] / spec.amplitude, bits)


def test_laws():
    with pytest.raises(ScenarioError, match="not empty, got 32"):
        prbs_bits(5, 32, 10)
    with pytest.raises(ScenarioError, match="prbs_s >= step_s"):
        build([Prbs(signal="prbs", step_s=2.0, prbs_s=1.0, **DE)], 10.0, 50.0)
    with pytest.raises(ScenarioError, match="at least one sample"):
        build([BinaryNoise(signal="gbn", step_s=0.01, gbn_s=1.0, **DE)], 10.0, 50.0)
