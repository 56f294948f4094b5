"""What several logs together say of coefficients: least squares, priors, and errors that all logs share."""

from typing import Literal

TrendVariable = Literal["auto", "none", "V", "qbar", "alpha"]
"""Variable that pooled coefficients may be linear in."""
