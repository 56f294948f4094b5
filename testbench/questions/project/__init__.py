"""What is the state of a campaign, from the drawing to the amended aircraft, and what comes next?

command (testbench new) -> new (the folder) -> standing (testbench alone in the folder)
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, new_project="new")
