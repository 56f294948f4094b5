"""Written by `python -m studies.blind --report` from results/gap/parts.csv."""

CALLED: dict[str, tuple[int, int, int]] = {
    "one effect": (170, 156, 172),
    "two effects": (26, 26, 30),
    "set": (11, 8, 11),
    "unexplained": (35, 0, 86),
}
"""Kind of call -> cases of the blind test with the right part, with the right effect, and all."""
