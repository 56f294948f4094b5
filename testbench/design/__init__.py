"""Inputs of a flight test: signal families, their information inside limits, and the search for the best.

A :class:`testbench.design.problem.Problem` is an aircraft seen through its sensors, with targets and limits. Who asks
makes it: a design, the studio, an environment.
"""
