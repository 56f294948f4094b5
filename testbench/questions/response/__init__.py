"""What are the frequency responses of recorded flights?

All records of a description are taken together. The answer gives magnitude, phase and coherence with their random error
and the bias of the windows; the method is for sweeps and multisines.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, frequency_responses="ask", response_page="page")
