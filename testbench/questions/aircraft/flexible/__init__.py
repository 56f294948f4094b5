"""Which modes did the ground test find, and what do they do in flight?

Asked with a rigid aircraft and the file of a ground vibration test. Answered by a folder: the same aircraft with its
elastic modes coupled to the air by strips, which every other question then flies.
"""

from testbench.questions.aircraft.flexible.ask import FlexibleAnswer, add_ground_test

__all__ = ["FlexibleAnswer", "add_ground_test"]
