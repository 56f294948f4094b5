"""Equation error: linear regression of aerodynamic forces and moments, and of motion, on measured signals."""

from testbench.estimators.regression.data import (
    MassProperties,
    Recipe,
    RegressionData,
    polynomial_terms,
    regression_data,
)
from testbench.estimators.regression.equation_error import LinearModel, equation_error, linear_model
from testbench.estimators.regression.frequency import frequency_equation_error
from testbench.estimators.regression.orthogonal import StructureSearch, orthogonal_functions
from testbench.estimators.regression.result import RegressionResult
from testbench.estimators.regression.smoothing import (
    Smoothed,
    fourier_smooth,
    local_polynomial,
    noise_level,
    smooth_record,
)

__all__ = [
    "LinearModel",
    "MassProperties",
    "Recipe",
    "RegressionData",
    "RegressionResult",
    "Smoothed",
    "StructureSearch",
    "equation_error",
    "fourier_smooth",
    "frequency_equation_error",
    "linear_model",
    "local_polynomial",
    "noise_level",
    "orthogonal_functions",
    "polynomial_terms",
    "regression_data",
    "smooth_record",
]
