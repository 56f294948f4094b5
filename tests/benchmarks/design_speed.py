"""How fast inputs are screened and designed; run with ``make benchmarks``. The laws, on one core:

10 000 candidates screened per minute; a whole design, flights included, within 30 s; and where the PyPI package aeroid
is installed, a 10 s multisine design at least 30 times faster than its own, which took 181 s when it was measured.
"""

import sys
import time
from importlib.util import find_spec
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from clock import since, some
from smallest import sized

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "design"))

from design_problems import problem

from testbench.core.paths import SCENARIOS
from testbench.design.refine import designed_multisine
from testbench.design.search import best_of_families, screen
from testbench.questions.design.ask import run_design
from testbench.questions.design.scenario import DesignScenario

AEROID_S = 181.0  # measured once, for a 10 s multisine

if __name__ == "__main__":
    for path in sorted((SCENARIOS / "design").glob("*.toml"))[: sized(None, 1)]:
        scenario = DesignScenario.load(path).changed(realise=0)  # the search alone
        start = time.process_time()
        result = run_design(scenario)
        whole = since(start)
        start = time.process_time()
        count = len(screen(result.problem))  # phases of multisines are known by now
        seconds = since(start)
        first = 60.0 * result.screened[0] / some(result.screened[1])
        print(
            f"{path.stem}: whole design {whole:.1f} s of processor time; {60.0 * count / seconds:.0f} candidates "
            f"screened per minute of it, {first:.0f} per minute of the clock while multisines still get their phases"
        )
    p = problem("eolo", 11.0, 0.1)
    ranked = screen(p)
    start = time.process_time()
    design = designed_multisine(p, best_of_families(ranked)["multisine"])[0]
    seconds = since(start)
    print(f"multisine of 10 s: designed in {seconds:.2f} s, {AEROID_S / seconds:.0f} times faster than {AEROID_S:g} s")
    if find_spec("aeroid") is None:
        print("aeroid is not installed: not timed beside it")
