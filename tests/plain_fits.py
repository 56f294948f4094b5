"""Identification without what is tried about a fit: for tests of what is made of its estimates.

Causes of residuals and remedies of a fit take most of the time of `identify`. Their tests are those of `inference/`, of
`identify` itself and, with the records of the tests that use this, in the slow suite.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from unittest import mock


@contextmanager
def plain_fits(plain: bool = True) -> Iterator[None]:
    """Look for no causes and try no remedies within the block, if ``plain``."""
    if not plain:
        yield
        return
    from testbench.inference import causes  # not where nothing is identified
    from testbench.questions.identify import ask

    with (
        mock.patch.object(ask, "mended_cases", lambda cases, gusts: (tuple(cases), frozenset(), [], {})),
        mock.patch.object(causes, "with_causes", lambda model, records: model),
    ):
        yield
