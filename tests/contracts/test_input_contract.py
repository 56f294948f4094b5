"""What every input family must do, and what build() adds to it."""

from typing import get_args

import numpy as np
import pytest

from testbench.core.constants import DEG_RAD
from testbench.core.errors import ScenarioError
from testbench.core.scenario.inputs import (
    BinaryNoise,
    Doublet,
    Input,
    Multisine,
    Multistep,
    Prbs,
    Pulse,
    StandardMultistep,
    Step,
    Sweep,
)
from testbench.inputs import FAMILIES, band_share, build, total_energy
from testbench.inputs.signal import energy_spectrum

A_DEG = 2.0
COMMON = {"control": "de", "amplitude_deg": A_DEG, "start_s": 1.0}
EXAMPLES = {
    "step": Step(signal="step", **COMMON),
    "pulse": Pulse(signal="pulse", width_s=0.8, **COMMON),
    "doublet": Doublet(signal="doublet", period_s=1.4, repeats=2, **COMMON),
    "3211": StandardMultistep(signal="3211", step_s=0.5, **COMMON),
    "multistep": Multistep(signal="multistep", step_s=0.5, pattern=(2, -1, 1), **COMMON),
    "211": StandardMultistep(signal="211", step_s=0.5, **COMMON),
    "123": StandardMultistep(signal="123", step_s=0.5, **COMMON),
    "sweep": Sweep(signal="sweep", f_start_hz=0.2, f_end_hz=4.0, sweep_s=8.0, **COMMON),
    "multisine": Multisine(signal="multisine", f_min_hz=0.25, f_max_hz=3.0, period_s=4.0, periods=2, **COMMON),
    "prbs": Prbs(signal="prbs", step_s=0.2, prbs_s=8.0, **COMMON),
    "gbn": BinaryNoise(signal="gbn", step_s=0.2, gbn_s=8.0, **COMMON),
}
# energy in units of A^2 s of the exact signals: the lengths of their steps; of sines about half their length
ENERGY = {
    "step": 9.0,
    "pulse": 0.8,
    "doublet": 2.8,
    "3211": 3.5,
    "211": 2.0,
    "123": 3.0,
    "multistep": 2.0,
    "sweep": 4.0,
    "multisine": 4.0,
    "prbs": 8.0,
    "gbn": 8.0,
}
DURATION_S, RATE_HZ = 10.0, 100.0


def test_the_table_holds_exactly_the_signals_of_the_scenario_schema() -> None:
    union = get_args(get_args(Input)[0])
    signals = {name for part in union for name in get_args(part.model_fields["signal"].annotation)}
    assert set(FAMILIES) == signals == set(EXAMPLES)
    assert all(description for _, description in FAMILIES.values())


@pytest.mark.parametrize("name", FAMILIES)
def test_family(name: str) -> None:
    made = build([EXAMPLES[name]], DURATION_S, RATE_HZ)
    u = made.u[:, 0]
    assert made.channels == ("de",)
    assert u.size == DURATION_S * RATE_HZ
    np.testing.assert_allclose(made.t_s, np.arange(u.size) / RATE_HZ, rtol=1e-15)
    assert not u[:100].any(), "zero deviation before start_s"
    assert (u[-1] == 0.0) == (name != "step"), "back at zero at the end, but for the step"
    # all but the sweep reach their amplitude exactly; a sampled sine comes within 1 - cos(pi / 25), 0.8 %, of it
    peak = np.abs(u).max() / (A_DEG * DEG_RAD)
    assert peak == pytest.approx(1.0, rel=8e-3 if name == "sweep" else 1e-15)
    assert peak <= 1.0


@pytest.mark.parametrize("name", FAMILIES)
def test_family_keeps_parseval(name: str) -> None:
    made = build([EXAMPLES[name]], DURATION_S, RATE_HZ)
    energy = total_energy(made.u, made.dt_s)[0] / (A_DEG * DEG_RAD) ** 2
    # the sweep's energy is T / 2 but for the end of sin(2 phi), within a quarter of its slowest period; the
    # multisine's is T / 2 if its relative peak factor is 1, and its square enters
    assert energy == pytest.approx(ENERGY[name], rel=0.1 if name in ("sweep", "multisine") else 1e-9)
    assert band_share(made.u, made.dt_s, 0.0, np.inf)[0] == pytest.approx(1.0, abs=1e-9)
    # the spectrum is band-limited to 2 T in lag: sampled every pi / T, its sum is its integral. Beyond W only the mean
    # sum J^2 / w^2 matters
    W = 3000.0
    step = np.pi / (1.05 * DURATION_S)
    omega = step * np.arange(1, round(W / step))
    spectrum = energy_spectrum(made.u, made.dt_s, np.concatenate([[0.0], omega]))[:, 0]
    jumps = np.diff(made.u[:, 0], prepend=0.0, append=0.0)
    total = step * (0.5 * spectrum[0] + spectrum[1:].sum()) + np.sum(jumps**2) / (omega[-1] + 0.5 * step)
    assert total / np.pi == pytest.approx(total_energy(made.u, made.dt_s)[0], rel=1e-4)


@pytest.mark.parametrize("name", FAMILIES)
def test_family_moves_with_its_start_and_scales_with_its_amplitude(name: str) -> None:
    spec = EXAMPLES[name]
    u = build([spec], DURATION_S, RATE_HZ).u[:, 0]
    later = build([spec.model_copy(update={"start_s": 1.5})], DURATION_S, RATE_HZ).u[:, 0]
    np.testing.assert_allclose(later[50:], u[:-50], atol=1e-12)
    opposite = build([spec.model_copy(update={"amplitude_deg": -2.0 * A_DEG})], DURATION_S, RATE_HZ).u[:, 0]
    np.testing.assert_allclose(opposite, -2.0 * u, rtol=1e-12)


@pytest.mark.parametrize("name", [n for n in FAMILIES if n != "step"])
def test_family_refuses_to_end_after_the_manoeuvre(name: str) -> None:
    with pytest.raises(ScenarioError, match="must end within duration_s = 10 s"):
        build([EXAMPLES[name].model_copy(update={"start_s": 9.5})], DURATION_S, RATE_HZ)


def test_build_sums_inputs_on_one_control_and_orders_controls() -> None:
    throttle = Pulse(signal="pulse", control="thr", amplitude_percent=10.0, width_s=2.0)
    made = build([throttle, EXAMPLES["pulse"], EXAMPLES["3211"]], DURATION_S, RATE_HZ)
    assert made.channels == ("de", "thr")
    one, two = (build([EXAMPLES[n]], DURATION_S, RATE_HZ).u[:, 0] for n in ("pulse", "3211"))
    np.testing.assert_allclose(made.u[:, 0], one + two, rtol=1e-15)
    np.testing.assert_allclose(made.u[:, 1], 0.1 * (np.arange(1000) < 200), rtol=1e-15)


def test_build_equals_the_sum_of_signals() -> None:
    parts = [build([EXAMPLES[name]], DURATION_S, RATE_HZ) for name in ("doublet", "sweep")]
    whole = build([EXAMPLES["doublet"], EXAMPLES["sweep"]], DURATION_S, RATE_HZ)
    np.testing.assert_allclose((parts[0] + parts[1]).u, whole.u, rtol=1e-15)


def test_build_lists_the_faults_of_all_inputs() -> None:
    late = EXAMPLES["pulse"].model_copy(update={"start_s": 9.9})
    short = EXAMPLES["multistep"].model_copy(update={"step_s": 0.001})
    with pytest.raises(ScenarioError) as caught:
        build([EXAMPLES["3211"], late, short], DURATION_S, RATE_HZ)
    assert [fault.split(":")[0] for fault in caught.value.faults] == [
        "input[1] (pulse on de)",
        *["input[2] (multistep on de)"] * 3,
    ]


def test_build_refuses_nothing_to_build() -> None:
    with pytest.raises(ScenarioError, match="at least one input"):
        build([], DURATION_S, RATE_HZ)
    with pytest.raises(ScenarioError, match="at least 2 samples"):
        build([EXAMPLES["step"]], 0.01, RATE_HZ)


def test_duration_that_is_no_whole_number_of_samples_rounds() -> None:
    assert build([EXAMPLES["step"]], 10.004, RATE_HZ).t_s.size == 1000
    assert build([EXAMPLES["step"]], 10.006, RATE_HZ).t_s.size == 1001
