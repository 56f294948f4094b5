"""JSBSim made to end its process inside a campaign, in the two known ways: one run is recorded, the rest is flown."""

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from questions.campaign.short_campaigns import SHORT
from studies.reliability.cases import Row, go_on

from testbench.questions.campaign.ask import DIED, Task, fly_campaign
from testbench.questions.campaign.flying import Job, Outcome
from testbench.questions.campaign.load import load_campaign
from testbench.questions.campaign.store import Store

WAYS = ("a model loaded twice", "a linearisation without engine")
RUNS, FATAL = 24, 7
_NO_ENGINE = """<?xml version="1.0"?>
<fdm_config name="none" version="2.0"><fileheader/>
<metrics><wingarea unit="M2">1</wingarea><wingspan unit="M">1</wingspan><chord unit="M">1</chord>
<location name="AERORP" unit="M"><x>0</x><y>0</y><z>0</z></location></metrics>
<mass_balance><ixx unit="KG*M2">1</ixx><iyy unit="KG*M2">1</iyy><izz unit="KG*M2">1</izz><emptywt unit="KG">1</emptywt>
<location name="CG" unit="M"><x>0</x><y>0</y><z>0</z></location></mass_balance>
<ground_reactions/><propulsion/><flight_control name="f"/><aerodynamics/></fdm_config>
"""


def fatal(way: str, model: str) -> Task:
    """Return a task whose run 7 has JSBSim end its process; by value, as workers know no tests."""

    def task(job: Job, runs: Sequence[int]) -> list[Outcome]:
        for run in runs:
            if run == FATAL:
                import gc
                import os
                import tempfile

                import jsbsim

                with tempfile.TemporaryDirectory() as root:
                    os.makedirs(f"{root}/aircraft/none")
                    with open(f"{root}/aircraft/none/none.xml", "w", encoding="utf-8") as file:
                        file.write(model)
                    fdm = jsbsim.FGFDMExec(root)
                    fdm.set_debug_level(0)
                    fdm.load_model("none")
                    if way == WAYS[0]:
                        fdm.load_model("none")
                    fdm.run_ic()
                    if way == WAYS[1]:
                        jsbsim.FGLinearization(fdm)
                    del fdm
                    gc.collect()
                raise RuntimeError("JSBSim did not end the process")
        found = json.dumps({"figures": {}, "poles": {}})
        return [Outcome(run, run, "{}", found, "", 0.0) for run in runs]

    return task


def trial(way: str, make: Callable[[str, str], Task] = fatal) -> tuple[str, str]:
    """Fly a campaign with one such run, and look at what is recorded."""
    with TemporaryDirectory() as place:
        file = Path(place, "short.toml")
        file.write_text(SHORT.format(head=f"runs = {RUNS}", vary=""), encoding="utf-8")
        ending = fly_campaign(load_campaign(file), Path(place, "s"), workers=2, task=make(way, _NO_ENGINE))
        with Store.read(Path(place, "s")) as store:
            failed = {row.run: row.reason for row in store.rows() if row.reason}
        said = f"{ending.counts.done} done, failed: {failed}"
        return ("one run recorded, the rest done" if failed == {FATAL: DIED} else "otherwise"), said


def crashes() -> list[Row]:
    """Fly a campaign for each way in which JSBSim ends its process."""

    def run(due: Sequence[str]) -> Iterator[tuple[str, str, str]]:
        for way in due:
            yield (way, *trial(way))

    return go_on("crashes", WAYS, run)
