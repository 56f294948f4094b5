"""What do several logs together say of the coefficients, and what did they add to what was believed before?

Every log gives coefficients with a covariance. Their information matrices are added; a coefficient may be linear in
speed, dynamic pressure or angle of attack; logs that disagree are said to; a prior is one more information matrix.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, identify_and_pool="ask")
