"""A small valid file of every kind that the door knows, and its reader: what the fuzzers damage."""

import io
import json
import shutil
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from fuzz import inputs

from testbench.aircraft.geometry.read import read_plan
from testbench.aircraft.geometry.shape import read_coordinates
from testbench.aircraft.model import read_aircraft
from testbench.aircraft.strips.ground_test import read_ground_test
from testbench.core.bring import declared
from testbench.core.paths import AIRCRAFT_MODELS, PACKAGE, SCENARIOS, SUITES
from testbench.core.project import read_project
from testbench.core.record import load_record
from testbench.envs.train import read_agent
from testbench.estimators.contract import Text
from testbench.logs.catalogue import writers_in
from testbench.pooling.prior import prior_of_file
from testbench.questions.campaign.flying import Outcome
from testbench.questions.campaign.load import load_campaign
from testbench.questions.campaign.store import FILE, Store
from testbench.questions.campaign.summary import summarise
from testbench.questions.campaign.tidy import tidy_store
from testbench.questions.compare.benchmark.ask import Kept
from testbench.questions.dataset.store import SUMS, damaged
from testbench.questions.design.ready import promise_of_file
from testbench.questions.exercise.answers import read_answers, template
from testbench.questions.exercise.roster import TABLE, exercises_of, students_of
from testbench.questions.exercise.seal import load_exercise, read_key
from testbench.questions.export.ask import load_matrices
from testbench.questions.files import load
from testbench.questions.importing.ask import import_log
from testbench.questions.live.clock import Clock
from testbench.questions.live.stream import recorded
from testbench.questions.sitl.outputs import read_settings
from testbench.sensors import load_suite

PLANS = Path(__file__).resolve().parents[1] / "aircraft" / "geometry" / "plans"
SHAPES = SCENARIOS / "ground_tests"
WRITERS = PACKAGE / "logs" / "writers"
EXERCISE = load_exercise("log_to_derivatives")
PRIOR = """source = "a tunnel"
[coefficient]
Cm_alpha = { value = -0.8, std = 0.1 }
Cm_q = { value = -12.0, percent = 20.0 }
"""
POOLED = {
    "coefficients": {"Cm_alpha": -0.8, "Cm_q": -12.0}, "slopes": {"Cm_q": 0.5}, "logs": ["one", "two"],
    "covariance_with_slopes": [[0.01, 0.0, 0.0], [0.0, 1.0, 0.1], [0.0, 0.1, 0.2]],
    "trend": {"variable": "alpha", "reference": 0.05},
}  # fmt: skip
PROMISE = {
    "targets": ["M_alpha", "M_q"], "believed": [-20.0, -3.0], "wanted": [1.0, None], "promised": [0.5, 0.2],
    "modes": {"short period": [[-2.0, 4.0]], "phugoid": [[-0.1, 0.2], [-0.1, -0.2]]}, "V_m_s": 12.0, "h_m": 100.0,
    "air": "still", "realised": None,
}  # fmt: skip
CELL = {
    "key": "k", "errors": [0.1, 0.2], "bound": None, "truth": [5.0, 0.5], "stated": {"wn": [0.1, 0.2]}, "seconds": 1.0,
    "reason": "",
}  # fmt: skip


class Example(NamedTuple):
    """A file of a kind: its name, its content, what reads it, and what must lie beside it."""

    name: str
    content: bytes
    read: Callable[[Path], object]
    beside: tuple[Path, ...] = ()

    def tried(self, content: bytes, folder: Path) -> object:
        """Return what the reader makes of another content."""
        for path in self.beside:
            (shutil.copytree if path.is_dir() else shutil.copy)(path, folder / path.name)
        path = folder / self.name
        path.write_bytes(content)
        return self.read(path)


PROJECT = (
    'title = "one"', 'aircraft = "taurus"', 'suite = "taurus_8hz"', "speeds_m_s = [12.0, 14.0]", "h_m = 100.0",
    "[limits]", "load_factor = [0.3, 1.7]", "[accuracies]", "M_q = 10.0", "[[history]]", 'at = "2026-01-01 10:00:00"',
    'command = "design longitudinal.toml"', 'result = "results/design_longitudinal"',
)  # fmt: skip


def _agent() -> bytes:
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w") as entries:
        entries.writestr("data", json.dumps({"task": "eolo", "decision_s": 0.1}))
        entries.writestr("policy.pth", b"numbers")
    return whole.getvalue()


def _avl(path: Path) -> object:
    return read_plan(path, path.with_name("trainer_mass.toml"))


def _followed(path: Path) -> object:
    clock, begun = Clock(), False
    for sample in recorded(path):
        clock.add(sample)
        if begun and (names := [*clock.rates()]):
            clock.block(names)
        elif clock.newest_s - clock.first_s > 1.0 and clock.rates():
            clock.start(20.0)
            begun = True
    return clock


def _store(path: Path) -> object:
    campaign = load_campaign("campaign/taurus_scatter")
    with Store.read(path.parent) as store, store.whole():
        store.counts(), store.seconds(), store.first_unfinished(), summarise(store.rows())
    list(tidy_store(path.parent))
    Store.resume(path.parent, campaign).close()
    return store


def _finished_store(place: Path) -> bytes:
    results = json.dumps({"figures": {"s, e": {"M_q": -3.0}}, "true": {"M_q": -3.1}, "failed": {"s, f": "no"}})
    with Store.create(place, load_campaign("campaign/taurus_scatter")) as store:
        store.exchange([Outcome(k, k, '{"condition.V_m_s": 13.0}', results, None, 0.1) for k in range(40)])
        store.exchange([Outcome(40, 40, "{}", None, "TrimError: no", 0.1)])
    return (place / FILE).read_bytes()


def _text(*lines: str) -> bytes:
    return "\n".join([*lines, ""]).encode()


@cache
def examples(place: Path) -> dict[str, Example]:
    """Return kind of the door -> its example; what must be made first is made in ``place``."""
    data, definitions = inputs.paparazzi()
    (place / "f.data").write_text(data, encoding="utf-8")
    record = inputs.record().save(place / "record.nc").read_bytes()
    eolo = AIRCRAFT_MODELS / "eolo"
    model = (eolo / "eolo.xml", eolo / "Engines")
    plan, shapes = eolo / "geometry.toml", SHAPES / "taurus_shapes.csv"
    out: dict[str, Example] = {
        "scenario": Example("s.toml", (SCENARIOS / "eolo_alpha.toml").read_bytes(), load),
        "suite": Example("s.toml", (SUITES / "eolo_alpha.toml").read_bytes(), lambda p: load_suite(str(p))),
        "aircraft": Example(
            "aircraft.toml", (eolo / "aircraft.toml").read_bytes(), lambda p: read_aircraft(p.parent), model
        ),
        "geometry": Example("geometry.toml", plan.read_bytes(), read_plan),
        "ground test": Example("taurus.toml", (SHAPES / "taurus.toml").read_bytes(), read_ground_test, (shapes,)),
        "structure": Example(
            "s.toml", (SCENARIOS / "structures" / "engine.toml").read_bytes(), lambda p: Text(p, "").made()
        ),
        "prior": Example("p.toml", PRIOR.encode(), prior_of_file),
        "answers": Example(
            "answers.toml", template("me", EXERCISE).encode(), lambda p: read_answers(p, EXERCISE.questions)
        ),
        "JSBSim model": Example(
            "eolo.xml", model[0].read_bytes(), lambda p: read_aircraft(p.parent), (eolo / "aircraft.toml", model[1])
        ),
        "project": Example("project.toml", _text(*PROJECT), read_project),
        "writer": Example("garmin.toml", (WRITERS / "garmin.toml").read_bytes(), lambda p: writers_in(p.parent)),
        "masses beside AVL": Example(
            "trainer_mass.toml", (PLANS / "trainer_mass.toml").read_bytes(),
            lambda p: _avl(p.with_name("trainer.avl")), (PLANS / "trainer.avl", PLANS / "tail.dat"),
        ),
        "AVL": Example(
            "trainer.avl", (PLANS / "trainer.avl").read_bytes(), _avl, (PLANS / "trainer_mass.toml", PLANS / "tail.dat")
        ),
        "airfoil": Example("tail.dat", (PLANS / "tail.dat").read_bytes(), read_coordinates),
        "shapes": Example(
            shapes.name, shapes.read_bytes(), lambda p: read_ground_test(p.with_name("taurus.toml")),
            (SHAPES / "taurus.toml",),
        ),
        "model": Example("m.json", inputs.model(), load_matrices),
        "pooled": Example("pooled.json", json.dumps(POOLED, indent=1).encode(), prior_of_file),
        "promise": Example("p.json", json.dumps(PROMISE, indent=1).encode(), promise_of_file),
        "campaign store": Example(FILE, _finished_store(place / "campaign"), _store),
        "journal": Example("cells.jsonl", _text(*[json.dumps(CELL)] * 5), lambda p: Kept(p).cells),
        "python": Example("m.py", _text("import math", "GAIN = 2.0", "def estimate(d):", "    return d"), declared),
        "agent": Example("a.zip", _agent(), read_agent),
        "key": Example("key", _text("0123456789abcdef0123"), read_key),
        "roster": Example("class.txt", _text("Ada", "Grace", "Émilie"), lambda p: students_of(str(p))),
        "log": Example("l.csv", inputs._csv(), import_log),
        "record": Example("record.nc", record, load_record),
        "recording": Example(
            "stream.jsonl", _text(*(json.dumps([0.05 * k] * 2 + [{"q": 0.1, "V": 12.0}]) for k in range(60))), _followed
        ),
        "parameters": Example("mine.parm", _text("SERVO1_FUNCTION 4", "SERVO2_FUNCTION,19"), read_settings),
        "definitions": Example(
            "f.log", definitions.encode(), lambda p: import_log(p.with_suffix(".data")), (place / "f.data",)
        ),
        "table": Example(
            TABLE, _text("student,exercise,folder", "Ada,static_margin,a"), lambda p: exercises_of(p.parent)
        ),
        "text": Example(SUMS, _text("0" * 64 + "  a", "1" * 64 + "  b"), lambda p: list(damaged(p.parent))),
    }  # fmt: skip
    return out


def read(kind: str, content: bytes, folder: Path, place: Path) -> Any:
    """Return what the reader of a kind makes of a content."""
    return examples(place)[kind].tried(content, folder)
