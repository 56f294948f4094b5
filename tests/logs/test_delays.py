"""The delay of each channel against rates and specific forces is found, with a standard deviation that holds."""

import numpy as np
import pytest

from testbench.core.constants import G0_M_S2
from testbench.questions.importing.ask import import_log
from testbench.questions.importing.page import import_answer, noise_rows

LATE = {"phi": 0.04, "theta": -0.03, "psi": 0.1, "hdot": 0.2}
HEADS = {"phi": "rad", "theta": "rad", "psi": "rad", "p": "rad/s", "q": "rad/s", "r": "rad/s", "ax": "m/s2",
         "ay": "m/s2", "az": "m/s2", "hdot": "m/s", "V": "m/s"}  # fmt: skip
NOISE = {"phi": 0.003, "theta": 0.003, "psi": 0.005, "p": 0.004, "q": 0.004, "r": 0.004, "ax": 0.1, "ay": 0.1,
         "az": 0.1, "hdot": 0.1, "V": 0.1}  # fmt: skip


def wave(t, seed):
    """A smooth random motion of unit size, below 1 Hz, and its slope."""
    rng = np.random.default_rng(seed)
    w, phase = rng.uniform(0.5, 6.0, 12), rng.uniform(0.0, 6.3, 12)
    a = rng.standard_normal(12) / np.sqrt(6.0)
    at = np.outer(t, w) + phase
    return np.sin(at) @ a, np.cos(at) @ (a * w)


def flight(folder, late, seed, noise=1.0):
    """Bank, pitch, heading and climb in waves, what rates and forces they take, and channels that are late."""
    t = np.arange(0.0, 120.0, 0.02)

    def motion(at):
        (phi, dphi), (theta, dtheta), (psi, dpsi), (climb, dclimb) = (wave(at, 10 * seed + k) for k in range(4))
        phi, dphi, theta, dtheta = 0.3 * phi, 0.3 * dphi, 0.08 * theta, 0.08 * dtheta
        psi, dpsi, climb, dclimb = 0.3 * psi, 0.3 * dpsi, 2.0 * climb, 2.0 * dclimb
        x = {"phi": phi, "theta": theta, "psi": psi, "hdot": climb, "V": np.full(at.size, 20.0)}
        x["p"] = dphi - dpsi * np.sin(theta)
        x["q"] = dtheta * np.cos(phi) + dpsi * np.sin(phi) * np.cos(theta)
        x["r"] = dpsi * np.cos(phi) * np.cos(theta) - dtheta * np.sin(phi)
        up = dclimb + G0_M_S2
        x["ax"], x["ay"], x["az"] = (up * n for n in (np.sin(theta), -np.sin(phi) * np.cos(theta),
                                                      -np.cos(phi) * np.cos(theta)))  # fmt: skip
        return x

    rng = np.random.default_rng(seed)
    columns = [motion(t - late.get(n, 0.0))[n] + noise * NOISE[n] * rng.standard_normal(t.size) for n in HEADS]
    header = "t [s]," + ",".join(f"{n} [{unit}]" for n, unit in HEADS.items())
    np.savetxt(folder / "f.csv", np.column_stack([t, *columns]), "%.7g", ",", header=header, comments="")
    return import_log(folder / "f.csv")


@pytest.mark.parametrize("late", [LATE, pytest.param({}, marks=pytest.mark.slow)], ids=["late", "on time"])
def test_delays_are_found_within_their_standard_deviations(tmp_path, late):
    off = []
    for seed in range(12):
        found = flight(tmp_path, late, seed).delays
        assert set(found) >= {"phi", "theta", "psi", "hdot"}
        off += [(found[n].s - late.get(n, 0.0)) / found[n].std_s for n in LATE]
        assert all(found[n].std_s < (0.002 if n != "theta" or not late else 0.04) for n in LATE)  # a late bank turns q
    assert (0.5 if not late else 0.1) < np.sqrt(np.mean(np.square(off))) < 1.5
    assert np.max(np.abs(off)) < 4.0


def test_a_late_channel_is_said_and_one_on_time_is_not(tmp_path):
    late = flight(tmp_path, LATE, 3)
    said = next(text for _, text in import_answer(late) if text.startswith("channels are apart in time"))
    for name in ("phi", "psi", "hdot"):
        assert f"{name} comes {1e3 * LATE[name]:.0f} ± " in said
    rows = {row[0]: row[-1] for row in noise_rows(late)}
    assert rows["psi"].endswith("ms after r")
    assert rows["V"] == "not told"
    on_time = flight(tmp_path, {}, 4)
    assert not [text for _, text in import_answer(on_time) if text.startswith("channels are apart")]
