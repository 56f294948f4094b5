"""Cost of the seams: a frame of JSBSim with them against the same model without, in one process.

Run with ``make benchmarks``. Each round steps all models of a line, one after the other in short turns, and takes the
ratio of each to the first, in processor time; the median over the rounds is printed, since machines are shared and
noisy. The law: at most 1.05 for the adapter of a stock model, and for one increment of a coefficient.
"""

import statistics
import sys
import time
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from clock import since
from smallest import sized

from testbench.aircraft import Aircraft, Amendment, Increment, ScaleCoefficient
from testbench.aircraft.adapter import Adapter
from testbench.aircraft.seams import opened
from testbench.flight import FlightCondition, load_aircraft, trim
from testbench.flight.executive import Executive
from testbench.flight.trim import place_at_trim

ROUNDS, TURNS, FRAMES = sized((41, 10, 150), (2, 1, 10))


def bare(aircraft: Aircraft) -> Aircraft:
    """Return a stock model as it comes: only what it is told before it flies, and properties that nothing defines."""
    assert aircraft.adapter is not None
    told = Adapter(settings=aircraft.adapter.settings, neutral=aircraft.adapter.neutral)
    return replace(aircraft, adapter=told, controls={})


def with_increment(aircraft: Aircraft) -> Aircraft:
    """Return the aircraft with a constant added to its pitching moment."""
    return aircraft.amended(Amendment("more", "more", (Increment("Cm", "benchmark", ("<value>1e-4</value>",)),)))


def with_tuned(aircraft: Aircraft) -> Aircraft:
    """Return the aircraft with the five coefficients re-tuned that the gap workflow re-tunes."""
    names = ("CL_alpha", "CD", "Cm_alpha", "Cm_q", "Cm_de")
    return aircraft.amended(Amendment("tuned", "tuned", tuple(ScaleCoefficient(n, 1.001) for n in names)))


def compare(title: str, models: dict[str, Aircraft], trimmed_as: Aircraft) -> None:
    """Print the median ratio of every model to the first."""
    condition = FlightCondition(trimmed_as.design_V_m_s, trimmed_as.design_h_m)
    trimmed = trim(trimmed_as, condition)
    still = replace(trimmed, controls={})
    times: dict[str, list[float]] = {name: [] for name in models}
    for _ in range(ROUNDS):
        ready = {}
        for name, aircraft in models.items():
            fdm = Executive(aircraft, trimmed.rate_hz, condition)
            place_at_trim(fdm, trimmed if aircraft.controls else still)
            ready[name] = fdm.fdm.run
        total = dict.fromkeys(models, 0.0)
        for _ in range(TURNS):
            for name, run in ready.items():
                start = time.process_time()
                for _ in range(FRAMES):
                    run()
                total[name] += since(start)
        for name, seconds in total.items():
            times[name].append(seconds)
    first = next(iter(models))
    print(f"{title}: {1e6 * statistics.median(times[first]) / (TURNS * FRAMES):.1f} us a frame, {first}")
    for name in list(models)[1:]:
        ratios = [a / b for a, b in zip(times[name], times[first], strict=True)]
        low, middle, high = statistics.quantiles(ratios, n=4)
        print(f"  {name}: {middle:.3f} times as long (half of the rounds from {low:.3f} to {high:.3f})")


def main() -> None:
    """Print the costs for a stock model and for one in the testbench's own form."""
    cessna, taurus = load_aircraft("jsbsim:c172p"), load_aircraft("taurus")
    compare("c172p, the adapter", {"as it comes": bare(cessna), "with the adapter": cessna}, cessna)
    changed = {
        "with the adapter": cessna,
        "with one increment": with_increment(cessna),
        "with five coefficients re-tuned": with_tuned(cessna),
        "with its elevator opened": opened(cessna, "de")[0],
    }
    compare("c172p, changed", changed, cessna)
    compare("taurus, changed", {"as it is": taurus, "with one increment": with_increment(taurus)}, taurus)


if __name__ == "__main__":
    main()
