"""Written by tests/studies/estimator_study.py from results/estimators/intervals.csv."""

HELD: dict[str, tuple[int, int, int]] = {
    "bootstrap": (86, 100, 400),
    "data compatibility": (95, 100, 400),
    "ekf": (88, 98, 400),
    "equation_error": (78, 100, 400),
    "equivalent, windowed": (62, 100, 400),
    "frequency response, windowed": (0, 97, 400),
    "srivc": (23, 98, 400),
    "ukf": (88, 98, 400),
}
"""Method -> least and largest share of its 95 % intervals that held the truth, %, and number of seeds."""
