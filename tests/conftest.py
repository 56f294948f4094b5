import gc
import os
import signal
from collections import Counter
from zlib import crc32

# Before numpy is imported: several test processes with several BLAS threads each stand in each other's way.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# A shell's background ignores these, and whatever a test starts would, too: what is tried with them would never end.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGHUP"):
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

import one_tree  # noqa: F401 (it is enough that it is imported)
import pytest
from browsers import Tab, chromium
from plain_fits import plain_fits as without_remedies
from quick_drawing import quick_drawing, rendering

from testbench.flight import FlightCondition, load_aircraft, trim


def pytest_collection():
    """Look for no garbage among ten thousand tests and their modules, which all stay: that is a third of the time."""
    gc.disable()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Leave most cases of a test that is marked ``sampled(every)`` to the slow suite, and begin with the longest test.

    Of every so many cases one stays, each time the next of them, so that of tests over two things each meets each.
    Meanwhile to mypy the other worker compiles the kernels, which both did.
    """
    seen = Counter()
    for item in items:
        mark = None if item.get_closest_marker("slow") else item.get_closest_marker("sampled")
        if mark is not None:
            (every,), test = mark.args, (item.path, item.originalname)
            group, place = divmod(seen[test], every)
            seen[test] += 1
            if place != (group + crc32(item.originalname.encode())) % every:  # of a table's tests each keeps others
                item.add_marker(pytest.mark.slow)
    items.sort(key=lambda item: not item.name.endswith("[mypy]"))


def pytest_collection_finish():
    """Nor later as often as Python does by itself, which takes a twelfth of the time of the tests."""
    gc.enable()
    gc.freeze()
    gc.set_threshold(20_000, 10, 10)


EOLO_CONDITION = FlightCondition(16.0, 547.0)
TAURUS_CONDITION = FlightCondition(12.0, 100.0)


@pytest.fixture(scope="session")
def eolo():
    return load_aircraft("eolo")


@pytest.fixture(scope="session")
def taurus():
    return load_aircraft("taurus")


@pytest.fixture(scope="session")
def eolo_trim(eolo):
    return trim(eolo, EOLO_CONDITION)


@pytest.fixture(scope="session")
def taurus_trim(taurus):
    return trim(taurus, TAURUS_CONDITION)


@pytest.fixture(scope="module")
def browser():
    with chromium() as running:
        yield running


@pytest.fixture(scope="module")
def _tab(browser):
    found = Tab(browser)
    yield found
    found.page.context.close()


@pytest.fixture
def tab(_tab):
    """Give a tab of the browser, in which no page may say or fetch anything."""
    _tab.told.clear()
    yield _tab
    assert _tab.told == []


@pytest.fixture(scope="module", autouse=True)
def figures_are_made(request):
    """Render figures in modules that are marked ``drawn`` alone; elsewhere they are made and not rendered."""
    if request.node.get_closest_marker("drawn"):
        yield
    else:
        with quick_drawing():
            yield


@pytest.fixture
def plain_fits(request):
    """Identify without causes and remedies in one test, unless it is of the slow suite."""
    with without_remedies(request.node.get_closest_marker("slow") is None):
        yield


@pytest.fixture(params=[True, pytest.param(False, marks=pytest.mark.slow)], ids=["plain", "mended"])
def plain_and_mended(request):
    """Identify without causes and remedies in one test, and with them in the slow suite."""
    with without_remedies(request.param):
        yield


@pytest.fixture
def rendered():
    """Render figures in one test of a module that is not marked ``drawn``."""
    with rendering():
        yield
