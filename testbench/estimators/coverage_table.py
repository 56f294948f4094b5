"""Written by tests/studies/estimator_study.py from results/estimators/intervals.csv."""

HELD: dict[str, tuple[int, int, int]] = {
    "equation_error": (21, 100, 400),
    "equivalent, windowed": (20, 100, 10),
    "frequency response, windowed": (0, 97, 400),
    "quiet regression": (91, 96, 400),
    "quiet structure search": (33, 94, 400),
    "regression": (0, 42, 60),
    "srivc": (0, 100, 6),
}
"""Method -> least and largest share of its 95 % intervals that held the truth, %, and number of seeds."""
