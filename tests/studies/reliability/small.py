"""Small cases of every command: a second of processor or so each, through the code that large ones go through.

A case is found by the command that it is of, "gap new", and a further one of a command by what follows a comma. What a
command reads is made once, by :func:`made`, and copied for each trial.
"""

import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from studies.reliability.process import Running
from studies.reliability.shorter import an_autopilot, few_designs, few_sections, few_speeds, one_height

from testbench.core.paths import SCENARIOS

PLAN = """
title = "One card"
aircraft = "taurus"
seed = 1
flown_by = "pilot"
speeds_m_s = [12.0]
heights_m = [100.0]
suite = "taurus_8hz"
uncertainty_percent = 15.0
limits = { speed_change_m_s = 4.0 }
timing = { turn_s = 45.0, overhead_s = 120.0 }
energy = { kind = "battery", capacity_Wh = 24.4, efficiency_percent = 45.0, source = "estimated" }

[[manoeuvre]]
name = "elevator doublet"
duration_s = 6.0
repeats = 2
[[manoeuvre.input]]
signal = "doublet"
control = "de"
amplitude_deg = 2.0
period_s = 2.0
pilot = { rise_s = 0.2, shortest_s = 1.0 }
"""
GAP = """
title = "Thrust above the centre of gravity"
aircraft = "taurus"
wings = "rigid"
suite = "eolo_gap"
seed = 1
simulation = { rate_hz = 100.0 }
effects = ["thrust_line"]
condition = { V_m_s = 13.0, h_m = 100.0 }
hidden = { effects = [{ effect = "thrust_line", z_m = 0.05 }] }

[[manoeuvre]]
name = "throttle doublet"
use = "identification"
duration_s = 4.0
input = [{ signal = "doublet", control = "thr", amplitude_percent = 15.0, period_s = 3.0 }]

[[manoeuvre]]
name = "elevator and throttle"
use = "validation"
duration_s = 5.0
input = [
  { signal = "doublet", control = "de", amplitude_deg = 1.5, period_s = 2.0 },
  { signal = "pulse", control = "thr", amplitude_percent = 15.0, width_s = 2.0, start_s = 2.5 },
]
"""
RUN = """
title = "One doublet"
aircraft = "taurus"
seed = 1
suites = ["taurus_8hz"]
condition = { V_m_s = 13.0, h_m = 100.0 }
simulation = { log_rate_hz = 40.0 }
[[manoeuvre]]
name = "doublet"
use = "split"
duration_s = 6.0
settle_s = 1.0
input = [{ signal = "doublet", control = "de", amplitude_deg = 1.5, period_s = 1.5, repeats = 2, spacing_s = 3.0 }]
[identification]
inputs = ["de_cmd"]
outputs = ["theta", "q"]
estimators = [{ method = "transfer_function", poles = 2, zeros = [0, 1] }]
"""
DESIGN = """
title = "The short period of the Taurus"
aircraft = "taurus"
suites = ["taurus_8hz"]
controls = ["de"]
duration_s = 4.0
start_s = 1.0
draws = 0
realise = 0
[condition]
V_m_s = 13.0
h_m = 100.0
[targets]
parameters = { M_alpha = 5.0, M_q = 5.0, M_de = 5.0 }
[limits]
deflection_deg = { de = 8.0 }
load_factor = [0.0, 2.0]
"""
COMPARE = """
title = "Two suites"
aircraft = "taurus"
seed = 1
seeds = 3
suites = ["taurus_8hz", "eolo_gap"]
simulation = { rate_hz = 400.0, log_rate_hz = 200.0 }
condition = { V_m_s = 13.0, h_m = 100.0 }
targets = { parameters = ["M_alpha", "M_q", "M_de"] }
identification = { inputs = ["de_cmd"], best_case = true }
[[manoeuvre]]
name = "3211"
use = "identification"
duration_s = 6.0
input = [{ signal = "3211", control = "de", amplitude_deg = 1.0, step_s = 0.3 }]
[[manoeuvre]]
name = "judge"
use = "validation"
duration_s = 4.0
input = [{ signal = "doublet", control = "de", amplitude_deg = 1.0, period_s = 1.0 }]
"""
MODES = """
title = "Wings in turbulence"
aircraft = "eolo"
seed = 1
suite = "eolo_ten_accelerometers"
condition = { V_m_s = 16.0, h_m = 547.0 }
air = { turbulence_rms_m_s = 1.0 }
flight = [{ name = "one", duration_s = 9.0 }, { name = "two", duration_s = 9.0 }]
modes = { band_hz = [5.0, 40.0] }
"""
FLIGHT = """
title = "One flight"
source = "made"
rights = "none"
time = { column = "t" }
record = [{ name = "a", file = "log.csv", use = "split" }]
channel = [
  { name = "de", column = "de", unit = "deg" }, { name = "q", column = "q", unit = "deg/s" },
  { name = "alpha", column = "alpha", unit = "deg" }, { name = "theta", column = "theta", unit = "deg" },
  { name = "V", column = "V", unit = "m/s" }, { name = "az", column = "az", unit = "m/s2" },
]
[identification]
inputs = ["de"]
outputs = ["q"]
estimators = [{ method = "dsr_e", order = 2, past_horizon = 4, future_horizon = 4 }]
"""


def log() -> str:
    """Return a table of a short period at 20 Hz, with two doublets."""
    lines, alpha, q, theta = ["t [s],de [deg],q [deg/s],alpha [deg],theta [deg],V [m/s],az [m/s2]"], 0.0, 0.0, 0.0
    for k in range(360):
        t = 0.05 * k
        de = 2.0 * sum((s <= t < s + 0.5) - (s + 0.5 <= t < s + 1.0) for s in (3.0, 12.0))
        lines.append(f"{t:.2f},{de},{q:.6f},{2 + alpha:.6f},{2 + theta:.6f},18.0,{-9.81 - 0.6 * alpha:.6f}")
        rates = q - 2.0 * alpha, -8.0 * alpha - 2.0 * q - 10.0 * de, q
        alpha, q, theta = (x + 0.05 * d for x, d in zip((alpha, q, theta), rates, strict=True))
    return "\n".join(lines) + "\n"


@dataclass(frozen=True)
class Case:
    """A small case.

    Attributes:
        words: of the command; {at} stands before what it reads and writes.
        needs: what it reads, of :func:`made`; the first is what is damaged.
        again: words that go on with it, tried in turn after it was stopped; the same words if none are given.
        status: with which it ends.
        most: it is one of the ten that write most.
        workers: it works in several processes.
        prepare: called in the process before the command, see :mod:`studies.reliability.shorter`.
        ends: what it has when it is told to stop is its result, which is shorter.
    """

    words: str
    needs: tuple[str, ...] = ()
    again: tuple[str, ...] = ()
    status: int = 0
    most: bool = False
    workers: bool = False
    prepare: Callable[[], object] | None = None
    ends: bool = False


_GAP = "gap {at}gap.toml -o {at}out --windows off"
_CAMPAIGN = "campaign {} {{at}}short.toml -o {{at}}out --workers 1"
CASES = {
    "run": Case("run {at}run.toml -o {at}out", ("run.toml",), most=True),
    "identify": Case("identify {at}log.toml -o {at}out", ("log.csv", "log.toml"), most=True),
    "global": Case(
        "global {at}g0.csv {at}g1.csv {at}g2.csv {at}g3.csv --aircraft taurus -o {at}out",
        ("g0.csv", "g1.csv", "g2.csv", "g3.csv"),
    ),
    "import": Case("import {at}log.csv -o {at}out", ("log.csv",), most=True),
    "export aircraft": Case("export aircraft taurus --to c -o {at}out"),
    "export file": Case("export {at}flown/whole.nc --to csv -o {at}out/r.csv", ("flown",)),
    "compatibility": Case("compatibility {at}log.toml -o {at}out", ("log.csv", "log.toml")),
    "response": Case("response {at}log.toml --window 5 -o {at}out", ("log.csv", "log.toml")),
    "modes": Case("modes {at}modes.toml -o {at}out", ("modes.toml",)),
    "gap show": Case(f"{_GAP} --workers 1", ("gap.toml",), most=True, prepare=one_height),
    "gap show, with flights again": Case(f"{_GAP} --workers 2 --again 2", ("gap.toml",), workers=True,
                                           prepare=one_height),
    "gap new": Case("gap new {at}mine.toml {at}flown --aircraft taurus", ("flown",)),
    "design": Case("design {at}design.toml -o {at}out", ("design.toml",), most=True, prepare=few_designs),
    "compare suites": Case("compare {at}compare.toml -o {at}out", ("compare.toml",)),
    "compare benchmark": Case("compare benchmark -o {at}out --seeds 1 --only dsr_e --data clean --workers 1"),
    "plan show": Case("plan {at}plan.toml -o {at}out", ("plan.toml",), most=True),
    "new": Case("new {at}out --aircraft taurus --sensors eolo_alpha"),
    "plan new": Case("plan new taurus -o {at}out/mine.toml"),
    "plan rehearse": Case("plan rehearse {at}plan.toml -o {at}out", ("plan.toml",)),
    "plan close": Case("plan close {at}plan.toml {at}logs/plan_flight_1.csv -o {at}out", ("plan.toml", "logs"),
                       most=True),
    "live": Case("live {at}g0.csv --aircraft taurus -o {at}out", ("g0.csv",), ends=True),
    "sitl": Case("sitl taurus --release 0 --idle 3 -o {at}out", prepare=an_autopilot, ends=True),
    "campaign run": Case(
        _CAMPAIGN.format("run"), ("short.toml",), (_CAMPAIGN.format("resume"), _CAMPAIGN.format("run")), most=True,
        workers=True,
    ),
    "campaign resume": Case(_CAMPAIGN.format("resume"), ("short.toml", "campaign:out"), workers=True),
    "campaign status": Case("campaign status {at}short.toml -o {at}out", ("short.toml", "campaign:out")),
    "campaign summarise": Case("campaign summarise {at}short.toml -o {at}out", ("short.toml", "campaign:out")),
    "dataset draw": Case("dataset {at}set.toml -o {at}out --workers 1", ("set.toml",), most=True, workers=True),
    "dataset score": Case("dataset score {at}set {at}answers.csv -o {at}out/scores.csv", ("answers.csv", "set")),
    "dataset check": Case("dataset check {at}set", ("set",)),
    "aircraft show": Case("aircraft taurus --wings rigid -o {at}out", prepare=few_speeds),
    "aircraft new": Case("aircraft new {at}plan_form.toml -o {at}out", ("plan_form.toml",)),
    "aircraft adopt": Case("aircraft adopt jsbsim:SGS -o {at}mine --report {at}out", prepare=few_speeds),
    "aircraft flexible": Case("aircraft flexible taurus {at}taurus.toml -o {at}out",
                              ("taurus.toml", "taurus_shapes.csv"), prepare=few_speeds),
    "studio": Case("studio taurus --write {at}out/studio.html"),
    "app": Case("app {at}nowhere", status=2),
    "results": Case("results {at}found", ("found",)),
    "results, two side by side": Case("results {at}found/one/run {at}found/two/run -o {at}out", ("found",)),
    "reproduce": Case("reproduce b1 -o {at}out", prepare=few_sections),
    "exercise list": Case("exercise list"),
    "exercise start": Case("exercise start doublet_length --student a -o {at}out"),
    "exercise roster": Case(
        "exercise roster {at}names.txt --exercise doublet_length --exercise static_margin -o {at}out",
        ("names.txt", "key.txt:out/key.txt"), most=True,
    ),
    "exercise marks": Case("exercise marks {at}class", ("class",)),
    "exercise check": Case("exercise check {at}handed", ("handed",), status=1),
    "check": Case("check {at}run.toml {at}plan.toml", ("run.toml", "plan.toml")),
    "list": Case("list scenarios"),
    "schema": Case("schema design -o {at}out"),
}  # fmt: skip
"""Name -> case."""


def leaves(group: Any = None, above: str = "") -> Iterator[str]:
    """Yield the commands that do something, found by walking the application: "run", "gap show", "gap new", ..."""
    if group is None:
        import typer.main

        from testbench.cli import app

        group = typer.main.get_command(app)
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from leaves(command, f"{above}{name} ")
        else:
            yield f"{above}{name}"


def words_of(text: str, at: str = "") -> list[str]:
    """Return the words of a command whose files lie in the working directory, or below ``at``."""
    return text.format(at=at).split()


def made(name: str, kit: Path) -> Path:
    """Return the file or folder that cases read, in ``kit``; it is made if it is not there."""
    path = kit / name
    if path.exists():
        return path
    if name in _WRITTEN:
        path.write_text(_WRITTEN[name](), encoding="utf-8")
        return path
    beside = kit / f"making_{name}"
    shutil.rmtree(beside, ignore_errors=True)
    beside.mkdir()
    for needed in _NEEDED.get(name, ()):
        shutil.copy(made(needed, kit), beside)
    for text in _MADE_BY[name]:
        done = Running(words_of(text), beside).ended()
        assert done.status == 0, f"testbench {text}: {done}"
    (beside / name).rename(path)
    shutil.rmtree(beside)
    return path


def place_of(case: Case, kit: Path, place: Path) -> Path:
    """Copy what a case reads into a folder of its own; return the folder."""
    place.mkdir(parents=True)
    for name in case.needs:
        what, _, where = name.partition(":")
        source, target = made(what, kit), place / (where or what)
        target.parent.mkdir(exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, target)
        else:
            shutil.copy2(source, target)
    return place


def _short() -> str:
    from questions.campaign.short_campaigns import SHORT

    return SHORT.format(head="runs = 4", vary="")


def _set() -> str:
    from drawn_sets import SMALL

    return SMALL.replace("flights = 60", "flights = 20")


def _at_speed(k: int) -> str:
    """Return a flight of the Taurus at one of four speeds, every control moving, as a table."""
    import numpy as np

    import testbench as tb
    from testbench.core.scenario.inputs import Multisine

    aircraft = tb.load_aircraft("taurus", "rigid")
    trimmed = tb.trim(aircraft, tb.FlightCondition(12.0 + k, 100.0))
    shared = {"signal": "multisine", "amplitude_deg": 2.0, "f_min_hz": 0.2, "f_max_hz": 2.0, "period_s": 5.0}
    inputs = [
        Multisine(**shared, control=c, periods=1, stride=3, first=i)  # type: ignore[arg-type]
        for i, c in enumerate(("de", "da", "dr"))
    ]
    manoeuvre = tb.Manoeuvre.of("all", inputs, 5.0, trimmed.rate_hz)
    flown = tb.fly_and_measure(tb.Job(aircraft, trimmed, manoeuvre, 48.0)).flown
    units = {
        "V": "m/s",
        "h": "m",
        "ax": "m/s2",
        "ay": "m/s2",
        "az": "m/s2",
        "p": "rad/s",
        "q": "rad/s",
        "r": "rad/s",
        "thr_cmd": "1",
    }
    names = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "h", "ax", "ay", "az", "de", "da", "dr", "thr_cmd")
    rows = np.column_stack([flown.t_s, flown.columns(names)])
    rows[:, 1:] += np.random.default_rng(k).standard_normal(rows[:, 1:].shape) * 1e-3
    head = ",".join(["t [s]", *(f"{n} [{units.get(n, 'rad')}]" for n in names)])
    return "\n".join([head, *(",".join(f"{x:.6g}" for x in row) for row in rows)]) + "\n"


def _plan_form() -> str:
    from any_aircraft import geometry_of_the_guide

    lines = geometry_of_the_guide().splitlines()
    return "\n".join(line for line in lines if not line.startswith(("da =", "dr =")))  # each control takes a second


def _example(name: str) -> Callable[[], str]:
    return lambda: (SCENARIOS / "ground_tests" / name).read_text(encoding="utf-8")


_WRITTEN: dict[str, Callable[[], str]] = {
    "plan.toml": lambda: PLAN, "gap.toml": lambda: GAP, "run.toml": lambda: RUN, "design.toml": lambda: DESIGN,
    "compare.toml": lambda: COMPARE, "modes.toml": lambda: MODES, "log.toml": lambda: FLIGHT, "log.csv": log,
    "short.toml": _short, "set.toml": _set, "plan_form.toml": _plan_form, "taurus.toml": _example("taurus.toml"),
    "taurus_shapes.csv": _example("taurus_shapes.csv"), "names.txt": lambda: "Ada\nJosé\nKim\n",
    "key.txt": lambda: "0123456789abcdef0123456789abcdef\n",
    **{f"g{k}.csv": partial(_at_speed, k) for k in range(4)},
    "answers.csv": lambda: "draw,figure,value,std\n2,M_q,-2.0,0.1\n",
}  # fmt: skip
_NEEDED = {"flown": ("log.csv",), "logs": ("plan.toml",), "campaign": ("short.toml",), "set": ("set.toml",),
           "found": ("run.toml",)}  # fmt: skip
_MADE_BY = {
    "flown": ("import log.csv -o flown",),
    "logs": ("plan rehearse plan.toml -o logs",),
    "campaign": ("campaign run short.toml -o campaign --workers 1",),
    "set": ("dataset set.toml -o set --workers 1",),
    "found": ("run run.toml -o found/one", "run run.toml -o found/two --seed 2"),
    "class": ("exercise roster 2 --exercise doublet_length -o class",),
    "handed": ("exercise start doublet_length --student a -o handed",),
}
