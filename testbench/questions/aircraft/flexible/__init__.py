"""Which modes did the ground test find, and what do they do in flight?

Asked with a rigid aircraft and the file of a ground vibration test. Answered by a folder: the same aircraft with its
elastic modes coupled to the air by strips, which every other question then flies.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, add_ground_test="ask", FlexibleAnswer="ask")
