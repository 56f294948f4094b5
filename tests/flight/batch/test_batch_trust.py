"""What the judge says of a structure, and what becomes of one that departs from JSBSim later.

Compilation of kernels.
"""

from typing import Any

import numba
import numpy as np
import pytest

from testbench.aircraft import Amendment, ScaleCoefficient
from testbench.envs.compiled import compiled
from testbench.flight import FlightCondition, Manoeuvre, load_aircraft, trim
from testbench.flight.batch import check
from testbench.flight.batch import fly as batch
from testbench.flight.batch.model import batch_model, variant
from testbench.inputs.signal import InputSignal


@pytest.fixture(autouse=True)
def own_verdicts(monkeypatch, tmp_path):
    """Keep no verdict of this file, and know none of others."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    for name in ("_JUDGED", "_BASES", "_REFUSED"):
        monkeypatch.setattr(check, name, type(getattr(check, name))())


def scaled(aircraft, factor: float):
    return aircraft.amended(Amendment("tuning", "re-tuned", (ScaleCoefficient("Cm_q", factor),)))


def pulses(aircraft, trimmed, n: int):
    t = np.arange(round(2.0 * trimmed.rate_hz)) / trimmed.rate_hz
    signals = (InputSignal(t, 0.01 * k * (t < 0.5)[:, None], ("de",)) for k in range(n))
    return [batch.Job(aircraft, trimmed, Manoeuvre("pulse", s, 0.0), 60.0) for s in signals]


def test_one_structure_is_judged_once_whatever_its_numbers_and_never_again_from_disk(taurus, monkeypatch):
    condition, flown = FlightCondition(15.0, 100.0), []
    compared = check.compared
    monkeypatch.setattr(check, "compared", lambda *given: flown.append(given) or compared(*given))
    for factor in (1.0, 1.1):
        amended = scaled(taurus, factor)
        assert check.judged(amended, trim(amended, condition)).model is not None
    assert len(flown) == 1
    for name in ("_JUDGED", "_BASES"):  # as in another process
        getattr(check, name).clear()
    other = scaled(taurus, 0.9)
    assert check.judged(other, trim(other, condition)).model is not None
    assert len(flown) == 1


def test_a_structure_that_departs_in_flight_is_flown_by_jsbsim_at_once_and_from_then_on(taurus, monkeypatch):
    trimmed = trim(taurus, FlightCondition(15.0, 100.0))
    jobs, told, fly_block = pulses(taurus, trimmed, batch.LANES), batch.Tally(), batch._fly_block
    right = batch.fly_jobs(jobs, "jsbsim")
    assert check.judged(taurus, trimmed).model is not None
    monkeypatch.setattr(batch, "BOTH", 1)
    blocks = []

    def off(lanes, flown):
        blocks.append(len(lanes))
        return [r.with_columns({"q": r["q"] + 1e-3}) for r in fly_block(lanes, flown)]

    monkeypatch.setattr(batch, "_fly_block", off)
    got = batch.fly_jobs(jobs, "auto", told)
    assert blocks == [len(jobs)]
    for a, b in zip(got, right, strict=True):
        np.testing.assert_array_equal(a.data, b.data)
    assert (told.both, told.batch, told.jsbsim) == (1, 0, len(jobs))
    assert check.judged(taurus, trimmed).model is None
    assert "departed from JSBSim" in check.judged(taurus, trimmed).reason


def test_few_flights_are_not_worth_a_judgement_unless_it_is_asked_for(taurus):
    trimmed = trim(taurus, FlightCondition(15.0, 100.0))
    told = batch.Tally()
    batch.fly_jobs(pulses(taurus, trimmed, 2), "auto", told)
    assert (told.batch, told.jsbsim) == (0, 2)


def test_models_share_a_program_that_reads_where_engines_are_until_one_of_them_stands_elsewhere():
    """Every variant of a stock aircraft with a propeller was translated anew, which took 30 ms for one of 1 ms."""
    condition, cessna = FlightCondition(45.0, 1000.0), load_aircraft("jsbsim:c172p")
    base = batch_model(scaled(cessna, 1.05), cessna.rate_hz, condition)
    assert any(n.endswith("y-position") for n in base.program.properties)
    other = scaled(cessna, 1.2)
    found = variant(base, other, condition, other.rigid_tree())
    assert found is not None
    assert found.program is base.program
    worst, name = check.compared(found, trim(other, condition))
    assert worst < check.TOLERANCE, name
    moved = other.rigid_tree()
    place = next(e for e in moved.iter("thruster")).find("location/y")
    place.text = str(float(place.text) + 1.0)
    assert variant(base, other, condition, moved) is None


def test_kernels_compile_where_nothing_can_be_written(monkeypatch: pytest.MonkeyPatch) -> None:
    real = numba.njit

    def njit(*functions: Any, **options: Any) -> Any:
        if options.get("cache"):
            raise RuntimeError("cannot cache function: no locator available for file")
        return real(*functions, **options)

    monkeypatch.setattr(numba, "njit", njit)

    def half(x: float) -> float:
        return 0.5 * x

    assert compiled(half)(3.0) == 1.5
