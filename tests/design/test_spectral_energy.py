"""Spectral energy of inputs: what the papers say of theirs, and what reaches each mode at each sensor."""

import numpy as np
import pytest

from testbench.core.scenario.inputs import Doublet, Pilot, StandardMultistep, Step, Sweep
from testbench.design.problem import ModeBands
from testbench.evaluation.excitation import excitation
from testbench.evaluation.modes import modes_of
from testbench.flight import linearise
from testbench.flight.linear_model import half_power_band
from testbench.inputs import build, energy_spectrum, frequency_below

DT = 0.01
NOISE = {"q": (0.0035, 0.01), "theta": (0.0035, 0.01), "az": (0.2, 0.01)}


@pytest.fixture(scope="module")
def eolo_linear(eolo, eolo_trim):
    return linearise(eolo, eolo_trim)


@pytest.fixture(scope="module")
def eolo_modes(eolo, eolo_linear):
    return modes_of(eolo_linear, eolo, "longitudinal")


def flown_3211():
    """The papers' 3-2-1-1 by hand: steps of 0.5 s, edges of 0.2 s (both estimated: neither paper prints them)."""
    by_hand = Pilot(rise_s=0.2)
    spec = StandardMultistep(signal="3211", control="de", amplitude_deg=5.0, step_s=0.5, pilot=by_hand)
    return build([spec], 25.0, 1.0 / DT)


def test_the_3211_of_eolo_stays_below_10_rad_s_and_does_not_excite_the_flexible_modes(eolo_linear, eolo_modes):
    """EOLO paper, Figure 4 and section 3.2."""
    signal = flown_3211()
    found = ModeBands(eolo_linear, eolo_modes, ("de",), NOISE, DT, len(signal.u)).analyse(signal.u)
    assert found.below_95[0] < 10.0
    assert found.excited("phugoid")
    assert found.excited("short period, slow root")
    for mode in found.modes:
        if "bending" in mode:
            assert not found.excited(mode)
            assert found.seen(mode)[1] < 0.0


def test_spectra_of_step_sweep_doublet_and_3211_as_in_the_taurus_paper():
    """Taurus paper, Figure 3: a step has its energy at zero, a doublet about w D = 2.33, a 3-2-1-1 over a wide band."""
    D = 1.0
    omega = np.linspace(0.01, 20.0, 8000)
    base = {"control": "de", "amplitude_deg": 3.0}
    spectra = {
        name: energy_spectrum(build([spec], 30.0, 100.0).u, DT, omega)[:, 0]
        for name, spec in {
            "step": Step(signal="step", **base),
            "doublet": Doublet(signal="doublet", period_s=2.0 * D, **base),
            "3211": StandardMultistep(signal="3211", step_s=D / 2.0, **base),
            "sweep": Sweep(signal="sweep", f_start_hz=0.1, f_end_hz=2.0, sweep_s=30.0, spacing="linear", **base),
        }.items()
    }
    peak = {name: omega[np.argmax(density)] for name, density in spectra.items()}
    assert peak["step"] < 0.1
    assert D * peak["doublet"] == pytest.approx(2.331, abs=0.01)  # of |4 sin^2(wD/2) / w|
    assert peak["doublet"] * D / 2.0 < peak["3211"] < 3.0 * D * peak["doublet"]

    def width(density):
        """Ratio of the frequencies between which the density is above a tenth of its peak."""
        inside = omega[density > 0.1 * density.max()]
        return inside[-1] / inside[0]

    assert width(spectra["3211"]) > 1.5 * width(spectra["doublet"])
    inside = (omega > 2.0) & (omega < 11.0)
    assert spectra["sweep"][inside].max() < 4.0 * spectra["sweep"][inside].min()  # flat between its two frequencies
    assert spectra["sweep"][omega > 16.0].max() < 0.05 * spectra["sweep"].max()
    below = {n: frequency_below(build([s], 30.0, 100.0).u, DT)[0] for n, s in {
        "step": Step(signal="step", **base), "doublet": Doublet(signal="doublet", period_s=2.0 * D, **base),
    }.items()}  # fmt: skip
    assert below["step"] < below["doublet"]


def test_the_fast_form_agrees_with_the_reference_form(eolo_linear, eolo_modes):
    u = flown_3211().u
    model = eolo_linear.longitudinal((1, 5, 7))
    old = excitation(model, eolo_modes, ("de",), u, DT, NOISE, len(u) * DT)
    new = ModeBands(model, eolo_modes, ("de",), NOISE, DT, len(u)).analyse(u)
    for k, mode in enumerate(old):
        assert new.share[k] == pytest.approx(mode.input_share, rel=0.02, abs=1e-6)
        for j, sensor in enumerate(new.sensors):
            assert new.snr_db[k, j] == pytest.approx(mode.snr_db[sensor], abs=0.3)


def test_energies_scale_with_the_square_and_sparse_equals_dense(eolo_linear, eolo_modes):
    bands = ModeBands(eolo_linear, eolo_modes, ("de",), NOISE, DT, 2500)
    u = flown_3211().u
    np.testing.assert_allclose(bands.snr_db(2.0 * u), bands.snr_db(u) + 20.0 * np.log10(2.0), atol=1e-9)
    dense = u + 1e-9 * np.sin(np.arange(len(u)))[:, None]
    np.testing.assert_allclose(bands.snr_db(dense)[:3], bands.snr_db(u)[:3], atol=1e-3)
    at_rest = bands.analyse(np.zeros_like(u))
    assert np.isnan(at_rest.below_95[0])
    assert not at_rest.excited("phugoid")


def test_half_power_bands():
    low, high = half_power_band(-1.0 + 10.0j, 100.0)
    assert (low, high) == pytest.approx((np.sqrt(101.0) - 1.0, np.sqrt(101.0) + 1.0))
    low, high = half_power_band(-0.001 + 10.0j, 10.0)
    assert high - low == pytest.approx(2.0 * np.pi / 10.0)  # no record resolves a narrower one
    assert half_power_band(-5.0 + 0.0j, 10.0)[1] == pytest.approx(5.0)
