"""Equation error of flights in still air, whose airspeed shows little but noise, on two aircraft over seeds."""

import numpy as np
import pytest
from estimator_cases import DT, LENGTHS, OUTPUTS, UNITS, _motion, _noisy, elevator, fly

from testbench.estimators.parametric import equation_error
from testbench.estimators.parametric.equation_error import Bias
from testbench.estimators.parametric.structures import longitudinal
from testbench.estimators.settings import EquationError

SEEDS = 20
NAMES = ("M_alpha", "M_q", "M_de")


def of_seeds(name):
    """Return bias of the seeds in stated errors (3,), relative bias (3,), and how many had a direction of noise."""
    true, std = _motion(name)
    std = std * np.array([6.0, 1.0, 1.0, 1.0])  # 1.2 m/s on airspeed, of which Taurus moves 0.1 to 0.2 m/s
    structure = longitudinal(true.trim, outputs=OUTPUTS)
    sizes = zip(LENGTHS, UNITS[name], strict=True)
    clean = [
        fly(true, true.values, 0.5 * elevator(name, n, unit), DT[name], np.zeros(4), held=True) for n, unit in sizes
    ]
    values = dict(zip(true.parameter_names, true.values, strict=True))
    off, errors, untold = [], [], 0
    for seed in range(SEEDS):
        model = equation_error.estimate(_noisy(clean, std, seed), structure, EquationError(held=("de",)))
        untold += any("half or more of the information" in a for a in model.advice)
        off.append([model.values[n] - values[n] for n in NAMES])
        errors.append([model.standard_errors[n] for n in NAMES])
    share = np.mean(off, axis=0) / np.array([values[n] for n in NAMES])
    return np.abs(np.mean(np.divide(off, errors), axis=0)), share, untold


@pytest.mark.slow  # eighty fits
@pytest.mark.parametrize(("name", "of_before"), [("taurus", 0.9), ("eolo", 0.6)])
def test_noise_of_the_airspeed_alone_does_not_switch_the_correction_off(name, of_before, monkeypatch):
    now, _, untold = of_seeds(name)
    assert untold >= 5

    corrected = equation_error.bias_of

    def all_or_nothing(*given):
        """The correction as it was: none where one combination of the parameters is noise."""
        bias = corrected(*given)
        f = bias.noise.size
        none = Bias(np.zeros(f), np.zeros(f), np.eye(f), np.zeros((f, f)), bias.untold, False)
        return none if bias.untold.any() else bias

    monkeypatch.setattr(equation_error, "bias_of", all_or_nothing)
    before, _, _ = of_seeds(name)
    # M_alpha, M_q and M_de together, in stated errors, the same seeds
    assert np.linalg.norm(now) < of_before * np.linalg.norm(before), (now, before)
