"""Which coefficients change with the flight condition: slopes kept by two tests, the variable by Akaike's criterion."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from scipy.stats import chi2 as chi_square
from scipy.stats import f as f_distribution

from testbench.core.errors import EstimationError
from testbench.questions.identify.pool.least_squares import Fit, LogCoefficients, Trend, all_names, alone, fit
from testbench.questions.identify.scenario import TrendVariable

VARIABLES = ("V", "qbar", "alpha")
_APART = 0.1  # two conditions are two if they differ by this share of the range of all
_RANGES = {"V": 0.05, "qbar": 0.1, "alpha": 0.0}  # least range of a variable, as a share of its largest value
_RANGE_ALPHA = 0.01  # rad; alpha may be about zero
_TRUSTED = 0.05  # probability of the scatter about all slopes above which the errors of the logs are taken as they are
_LEAST = 3  # conditions that a line needs for one to be left over that it is judged by


def best_trend(logs: Sequence[LogCoefficients], asked: TrendVariable, level: float) -> Fit:
    """Return the fit with the slopes that the logs show.

    Forward: the slope that lowers chi-square most comes next, as long as chi-square with one degree of freedom says
    that chance would not do so. That trusts the errors of the logs. Where the logs scatter more than their errors even
    about all slopes, the slope of a coefficient must also pass an F test against the scatter of that coefficient
    alone. The level is divided by the number of slopes still left to try and by the number of variables (S. Holm,
    Scandinavian Journal of Statistics 6, 1979), so that of sets of logs without trends at most that share shows one.
    Of several variables that with the least chi-square + 2 x slopes is taken (H. Akaike, IEEE Transactions on
    Automatic Control 19(6), 1974; the errors are known).

    Raises:
        EstimationError: the variable that is asked for is not known of every log.
    """
    flat = fit(logs)
    if asked == "none":
        return flat
    wanted = VARIABLES if asked == "auto" else (asked,)
    known = [v for v in wanted if all(v in log.at for log in logs)]
    if asked != "auto" and not known:
        lacking = ", ".join(log.log for log in logs if asked not in log.at)
        raise EstimationError(f"a trend with {asked} needs it of every log, but it is not known of {lacking}")
    tried = [_forward(logs, flat, v, level / len(known)) for v in known]
    return min([flat, *tried], key=lambda found: found.chi2 + 2.0 * len(found.trend.names))


def _forward(logs: Sequence[LogCoefficients], flat: Fit, variable: str, level: float) -> Fit:
    reference = sum(log.at[variable] for log in logs) / len(logs)
    left = [name for name in all_names(logs) if _conditions(logs, name, variable) >= _LEAST]
    if not left:
        return flat
    full = fit(logs, Trend(variable, reference, tuple(left)))
    trusted = float(chi_square.sf(full.chi2, full.dof)) > _TRUSTED
    own = {} if trusted else {name: _chance_by_scatter(logs, name, variable, reference) for name in left}
    found = flat
    while left:
        tried = [fit(logs, Trend(variable, reference, (*found.trend.names, name))) for name in left]
        best = min(tried, key=lambda t: t.chi2)
        gain = max(found.chi2 - best.chi2, 0.0)
        chance = max(float(chi_square.sf(gain, 1)), own.get(best.trend.names[-1], 0.0))
        if chance * len(left) >= level:
            break
        found = best
        left.remove(best.trend.names[-1])
    return found


def _chance_by_scatter(logs: Sequence[LogCoefficients], name: str, variable: str, reference: float) -> float:
    """Return the probability that scatter of one coefficient about a constant looks as much like a slope (F test)."""
    own = alone(logs, name)
    flat, line = fit(own), fit(own, Trend(variable, reference, (name,)))
    if line.chi2 <= 0.0:
        return 0.0
    return float(f_distribution.sf((flat.chi2 - line.chi2) / (line.chi2 / line.dof), 1, line.dof))


def _conditions(logs: Sequence[LogCoefficients], name: str, variable: str) -> int:
    """Return at how many different values of the variable logs hold a coefficient."""
    x = sorted(log.at[variable] for log in logs if name in log.names)
    reach = x[-1] - x[0]
    if reach <= max(_RANGES[variable] * abs(x[-1]), _RANGE_ALPHA):
        return 1
    return 1 + sum(b - a > _APART * reach for a, b in pairwise(x))
