"""What are the frequency responses of recorded flights?

All records of a description are taken together. The answer gives magnitude, phase and coherence with their random
error and what the windows do to them; sweeps and multisines are what it is for.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, frequency_responses="ask", response_page="page")
