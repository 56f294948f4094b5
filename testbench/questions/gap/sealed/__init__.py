"""The cases of the blind test: hidden truths drawn by stratum, and what an answer to one of them is worth.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""
