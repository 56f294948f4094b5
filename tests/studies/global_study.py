"""Global models of simulated flights against the aircraft's own tables: results/estimators/global.csv.

Run with ``make global-study``. Ten flights of 60 s each of JSBSim's F-16, T-38 and Cessna 172 (``global_flights``), one
held out, give the six coefficients as functions. The truth are the aircraft's own at 1000 states drawn in the domain.

Instruments "as sold" are packaged ones with noise, zeros, lags and quanta; the lags of data sheets are taken out.
"drawn" ones have scales and clocks besides as far off as those of sound instruments are, drawn anew for every seed, and
the model is told those standard deviations.

near_percent: states at which a function is within 5 % of the range that its coefficient has over them, mean of the
seeds; least_percent: the smallest of them. error_90: error that nine tenths of the states have at most, percent of it.
z_rms: root mean square of error over stated standard error; within_2: states that are within two of them, percent.
"""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from global_flights import ENVELOPES, aircraft_of, at_states, coefficients_of, drawn, given_states, logs
from smallest import results, sized
from tables import write_rows

from testbench.inference.instruments import sound
from testbench.questions.global_model.ask import global_model
from testbench.questions.global_model.coefficients import COEFFICIENTS, NEEDED

_NEAR = 0.05
_STATES = 1000
_LOG_S = 0.01


def judged(name: str, erring: bool, seed: int) -> Iterator[tuple[int, float, float, float, float]]:
    """Yield of each coefficient: terms, share of near states, error of nine tenths, mean square of z, z within 2."""
    std = {n: s for c in NEEDED if c != "h" for n, s in sound(c, _LOG_S).items()} if erring else {}
    rng = np.random.default_rng([seed, 31])
    errors = {n: s * float(rng.standard_normal()) for n, s in std.items()}
    aircraft, h = aircraft_of(name), ENVELOPES[name].h_m
    found = global_model(logs(name, seed, errors), aircraft, instrument_std=std)
    states = drawn(found.model.domain, rng, _STATES)
    given = given_states(aircraft, states, found.V_ref_m_s, h)
    truth = coefficients_of(aircraft, at_states([aircraft], given, found.V_ref_m_s, h)[0], states)
    for c, (value, error) in found.model.at(states).items():
        off, span = np.abs(value - truth[c]), float(np.ptp(truth[c]))
        terms = len(found.model.functions[c].terms) - 1
        z = off / error
        yield (
            terms,
            float(np.mean(off <= _NEAR * span)),
            float(np.quantile(off, 0.9)) / span,
            float(np.mean(z**2)),
            float(np.mean(z <= 2.0)),
        )


def rows(seeds: int) -> Iterator[dict[str, object]]:
    """Yield the rows of the table."""
    for name in sized(tuple(ENVELOPES), ("T38",)):
        for erring in sized((False, True), (False,)):
            every = np.array([list(judged(name, erring, s)) for s in range(seeds)])  # (seeds, coefficients, figures)
            for i, c in enumerate(COEFFICIENTS):
                terms, near, error, z2, two = every[:, i].T
                yield {
                    "aircraft": name, "instruments": "drawn" if erring else "as sold", "coefficient": c, "seeds": seeds,
                    "terms": f"{terms.mean():.0f}", "near_percent": f"{100.0 * near.mean():.0f}",
                    "least_percent": f"{100.0 * near.min():.0f}", "error_90": f"{100.0 * error.mean():.2f}",
                    "z_rms": f"{np.sqrt(z2.mean()):.2f}", "within_2": f"{100.0 * two.mean():.0f}",
                }  # fmt: skip
                print(name, erring, c, f"{100.0 * near.mean():.0f}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=sized(5, 1))
    found = list(rows(parser.parse_args().seeds))
    write_rows(results("estimators", "global.csv"), found[0], found)
