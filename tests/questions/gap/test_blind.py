"""The blind test: truths fly and are sealed, answers are scored, and an interrupted run goes on where it stopped."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from studies.blind import __main__ as command
from studies.blind import rows, servos
from studies.blind.cases import Case, draw, opened, seal
from studies.blind.flights import fly_truth
from studies.blind.kinds import KINDS, parameter_errors
from studies.blind.report import write_report
from studies.blind.run import believe
from studies.blind.score import judge, rates
from studies.blind.truth import Truth
from studies.blind.truths import SERVO_LAG, TRUTHS

from testbench.core.proportion import proportion_interval
from testbench.effects import library

TESTS = Path(__file__).resolve().parents[2]


def case(*right: tuple[str, ...], stratum: str = "library form", kinds: tuple[str, ...] = ()) -> Case:
    return Case("a", stratum, "eolo", kinds, tuple({} for _ in kinds), {}, right)


def row(outcome: str, *names: str) -> dict:
    return {
        "outcome": outcome, "names": list(names), "best": names[0] if names else "", "values": {"lag_rad_s": 11.0},
        "errors": {"lag_rad_s": 0.5}, "share": 0.99, "gain": 100.0, "runner_up": "", "removed": 0.95, "seconds": 2.0,
    }  # fmt: skip


def test_names_that_are_right_are_names_of_the_library():
    known = set(library(believe("eolo").suite))
    for name, kind in KINDS.items():
        assert set(kind.names) <= known, name
        assert bool(kind.names) is (kind.form != "unseen"), name


@pytest.mark.parametrize("aircraft", ["eolo", "taurus"])
def test_a_truth_with_nothing_hidden_is_what_is_believed(aircraft):
    """Residuals are white with variance one: five sigma of the mean square of 800 samples a channel, false alarm 3e-6
    per channel."""
    believed = believe(aircraft)
    record = next(iter(fly_truth(aircraft, Truth(), "short", 3).values()))
    energy = (believed.residuals(record) ** 2).mean(axis=0)
    assert energy == pytest.approx(np.ones(5), abs=5 * np.sqrt(2 / len(record)))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", KINDS)
def test_every_kind_of_truth_flies_and_leaves_the_commands_as_issued(name):
    aircraft = "eolo" if name == "flexible wings" else "taurus"
    kind = KINDS[name]
    for seed in range(6):  # some sizes take the aircraft out of its limits; the draw of the test skips them, too
        sizes = kind.draw(np.random.default_rng(seed))
        try:
            records = fly_truth(aircraft, TRUTHS[name](sizes, aircraft), "short", 1)
            break
        except Exception as error:
            failure = error
    else:
        raise AssertionError(f"{name} never flew") from failure
    plain = fly_truth(aircraft, Truth(), "short", 1)
    differs = False
    for key, record in records.items():
        command_now, command_plain = (r["de_cmd"] - r["de_cmd"][0] for r in (record, plain[key]))
        assert np.allclose(command_now, command_plain, atol=1e-12)
        differs = differs or any(
            not np.array_equal(record[c], plain[key][c]) for c in ("V", "alpha", "q", "theta", "az")
        )
    motors = ("slow motor", "motor of two times", "motor of two stages", "motor with a bent curve", "stronger motor")
    assert differs or name in motors  # these flights leave the throttle where it is


def test_cases_are_drawn_alike_sealed_and_opened():
    cases = draw(4, {"library form": 1, "nothing in turbulence": 1, "two at once": 1})
    text, digest = seal(cases)
    assert seal(draw(4, {"library form": 1, "nothing in turbulence": 1, "two at once": 1})) == (text, digest)
    assert seal(draw(5, {"library form": 1}))[1] != seal(draw(4, {"library form": 1}))[1]
    assert seal(opened(text)) == (text, digest)
    assert cases[1].turbulence_rms_m_s == 0.25
    assert len(cases[2].kinds) == len(cases[2].right) == 2


def test_sizes_below_detectability_change_next_to_nothing():
    """What is hidden changes the readings, over all records, by less than noise itself scatters in one number of 18."""
    for hidden in draw(4, {"below detectability": 2}):
        seen = hidden.fly("rich")
        plain = replace(hidden, kinds=(), sizes=()).fly("rich")
        believed = believe(hidden.aircraft)
        energy = 0.0
        for name, record in seen.items():
            d = believed.in_noise_units(
                record, record.columns(believed.outputs) - plain[name].columns(believed.outputs)
            )
            energy += float(np.sum(d**2))
        assert 0.0 < energy < 9.5


def test_parameter_errors_scatter_as_stated():
    drawn = np.array([list(parameter_errors(np.random.default_rng(s)).values()) for s in range(400)])
    # A normal clipped at two sigma has a standard deviation of 0.96; that of 400 draws scatters by 0.035: 3.4 of it,
    # false alarm 4e-3 for five factors, seeds fixed.
    assert drawn.std(axis=0) / [0.05, 0.10, 0.10, 0.15, 0.10] == pytest.approx(np.full(5, 0.96), abs=0.12)


@pytest.mark.parametrize(
    ("right", "said", "verdict"),
    [
        ((("lag", "lag2"),), row("named", "lag2"), "right"),
        ((("lag",),), row("named", "delay"), "wrong"),
        ((("lag",),), row("set", "delay", "lag"), "in set"),
        ((("lag",),), row("set", "delay", "play"), "wrong set"),
        ((("lag",),), row("named", "lag + delay"), "wrong"),
        ((("lag", "delay"),), row("named", "lag + delay"), "right"),
        ((("lag", "delay"),), row("named", "lag + gain"), "wrong"),
        ((("lag", "delay"), ("gain",)), row("named", "lag + delay"), "one of two"),
        ((("lag",),), row("unexplained"), "unexplained"),
        ((("lag",),), row("no gap"), "none"),
        ((("lag",), ("gain",)), row("named", "gain + lag"), "right"),
        ((("lag",), ("gain",)), row("named", "gain"), "one of two"),
        ((("lag",), ("gain",)), row("named", "gain + delay"), "wrong"),
        ((), row("named", "lag"), "wrong"),
        (((),), row("set", "lag", "gain"), "wrong set"),
    ],
)
def test_verdicts(right, said, verdict):
    assert judge(case(*right), said).verdict == verdict


def test_wilson_intervals():
    """Against R's binom.confint(method = "wilson"), figures from memory checked with the formula by hand."""
    assert proportion_interval(0, 30) == pytest.approx((0.0, 0.1135), abs=1e-4)
    assert proportion_interval(30, 30) == pytest.approx((0.8865, 1.0), abs=1e-4)
    assert proportion_interval(5, 10) == pytest.approx((0.2366, 0.7634), abs=1e-4)
    assert proportion_interval(0, 0) == (0.0, 1.0)


def test_rates_count_what_they_say():
    scores = [judge(case(("lag",)), row("named", n)) for n in 6 * ("lag", "lag", "lag", "delay")]
    by_name = {r.name: r for r in rates(scores)}
    right, wrong = by_name["library form: right name"], by_name["library form: wrong name"]
    assert (right.count, right.of, right.met) == (18, 24, "no")
    assert (wrong.count, wrong.of, wrong.met) == (6, 24, "no")
    assert by_name["unseen: false name"].met == "too few cases"


def test_hidden_servos_are_what_they_say():
    u, dt = np.concatenate([np.zeros(10), np.ones(190)]), 0.01
    t = np.arange(190) * dt
    ramp = (np.exp(0.2) - 1.0) / 0.2  # the step is taken as a ramp over the frame before it
    assert servos.stages(20.0, 1)(u, dt)[10:] == pytest.approx(1.0 - ramp * np.exp(-20.0 * (t + dt)), abs=1e-9)
    assert servos.late(0.05)(u, dt).sum() == pytest.approx(185.0)
    assert servos.late(0.052)(u, dt)[14:17] == pytest.approx([0.0, 0.8, 1.0])  # between two frames
    assert servos.sprung(30.0, 0.7)(u, dt)[-1] == pytest.approx(1.0, abs=1e-3)
    limited = servos.slewing(50.0, 0.5, 0.5, soft=False)(u, dt)
    assert np.max(np.diff(limited)) == pytest.approx(0.5 * dt, rel=1e-6)
    wave = 0.1 * np.sin(2 * np.pi * np.arange(400) * dt)
    assert np.ptp(servos.backlash(0.04)(wave, dt)[100:]) == pytest.approx(0.16, abs=1e-3)
    assert np.ptp(servos.soft_play(0.04)(wave, dt)[100:]) < 0.2
    doubled = servos.soft_play(0.08)(2.0 * wave, dt)  # all goes with the width of the play
    assert doubled == pytest.approx(2.0 * servos.soft_play(0.04)(wave, dt))
    assert servos.reluctant(50.0, 0.03)(0.02 * u, dt) == pytest.approx(np.zeros(200))
    assert servos.motor(0.5, 0.5)(u, dt)[59] == pytest.approx(1.0 - np.exp(-1.0), abs=1e-9)
    assert set(servos.coarse(0.05)(wave, dt)) <= set(0.05 * np.arange(-3, 4))
    assert np.ptp(servos.stuck(0.5, 1.0)(wave, dt)[50:150]) == 0.0


@pytest.mark.parametrize("aircraft", ["eolo", "taurus"])
def test_a_hidden_servo_that_changes_nothing_shows_nothing(aircraft):
    """Else every hidden servo would bring a gap of its own making. The noise is the same in both; what is left is the
    slew limit, met in the sweep outside the lag instead of inside, and less than what is ever named.
    """
    believed = believe(aircraft)
    own = servos.after_lag(SERVO_LAG[aircraft], lambda u, dt_s: u)
    flown = [fly_truth(aircraft, p, "rich", 5) for p in (Truth(), Truth(elevator=own, whole_servo=True))]
    plain, again = (sum(float(np.sum(believed.residuals(r) ** 2)) for r in f.values()) for f in flown)
    assert abs(again - plain) < 40.0


def test_a_run_resumes_and_a_changed_seal_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(command, "COUNTS", {"nothing": 2})
    ran: list[str] = []

    def name_case(aircraft, records, held_out, without=(), simulator="auto", only=()):
        ran.append(aircraft)
        return row("no gap")

    monkeypatch.setattr(rows, "name_case", name_case)
    arguments = ["--out", str(tmp_path / "b"), "--seed", "7"]
    command.main([*arguments, "--cases", "1"])
    assert len(ran) == 1
    command.main(arguments)
    assert len(ran) == 4  # each once more on two manoeuvres
    assert "2 of 2 cases" in (tmp_path / "b" / "README.md").read_text(encoding="utf-8")
    answers = tmp_path / "b" / "answers.json"
    changed = json.loads(answers.read_text(encoding="utf-8"))
    changed[0]["seed"] += 1
    answers.write_text(json.dumps(changed, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    with pytest.raises(SystemExit, match="must be those sealed"):
        command.main(arguments)


def test_what_workers_are_given_is_where_a_spawned_process_finds_it():
    assert not [f for f in (command.run_case, command.leave_with) if f.__module__.endswith("__main__")]


@pytest.mark.skipif(sys.platform != "linux", reason="asks /proc")
@pytest.mark.slow
def test_workers_end_with_a_run_that_is_killed():
    script = (
        "import os, time\n"
        "from concurrent.futures import ProcessPoolExecutor\n"
        "from multiprocessing import get_context\n"
        "from studies.blind.rows import leave_with\n"
        "pool = ProcessPoolExecutor(1, get_context('spawn'), initializer=leave_with, initargs=(os.getpid(),))\n"
        "if __name__ == '__main__':\n"
        "    print(pool.submit(os.getpid).result(), flush=True)\n"
        "    time.sleep(60)\n"
    )
    environment = os.environ | {"PYTHONPATH": str(TESTS)}
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True, env=environment) as run:
        worker = int(run.stdout.readline())
        assert runs(worker)
        run.kill()
    latest = time.monotonic() + 10.0
    while runs(worker) and time.monotonic() < latest:
        time.sleep(0.1)
    assert not runs(worker)


def runs(process: int) -> bool:
    """Whether a process is there and has not ended (Z: ended, and nobody has asked how)."""
    status = Path(f"/proc/{process}/stat")
    return status.exists() and status.read_text(encoding="utf-8").rpartition(")")[2].split()[0] != "Z"


def test_the_report_reads_out_rates_sizes_and_confusion(tmp_path):
    cases = [
        Case(
            "library form 1", "library form", "eolo", ("slow servo",), ({"lag_rad_s": 10.0},), {}, (("actuator_lag",),)
        ),
        Case("nothing 1", "nothing", "eolo", (), (), {}, ()),
        Case("unseen 1", "unseen", "eolo", ("gust",), ({},), {}, ((),)),
    ]
    rows = {
        "library form 1": row("named", "actuator_lag"),
        "library form 1, true effect taken out": row("named", "transport_delay")
        | {"chi2_left": 990.0, "samples": 1000},
        "library form 1, two manoeuvres": row("set", "transport_delay", "actuator_lag"),
        "nothing 1": row("no gap"),
        "unseen 1": {"outcome": "failed", "names": [], "why": "x"},
    }
    write_report(tmp_path, cases, rows, "abc", 1)
    page = (tmp_path / "README.md").read_text(encoding="utf-8")
    assert "2 of 3 cases have been run; failed: unseen 1" in page
    without = page.partition("## Names where")[2]
    assert "Of the 1 that were given, 1 leave nothing that is told from noise" in without
    assert "| slow servo | transport_delay | yes |" in without
    told = (tmp_path / "without.csv").read_text(encoding="utf-8").splitlines()
    assert told[1:] == ["library form 1,slow servo,actuator_lag,named,transport_delay,990,1000"]
    assert "| library form: right name | 1 of 1 | 100 % | 21 to 100 % | ≥ 92 % | too few cases |" in page
    assert "| library form: right name | 0 of 1 | 0 % | 0 to 79 % |\n" in page.partition("## Two manoeuvres")[2]
    assert "| slow servo | 1 of 1 |  | 0 of 1 |" in page
    confusion = (tmp_path / "confusion.csv").read_text(encoding="utf-8")
    assert "six,slow servo,actuator_lag,1" in confusion
    assert "two,slow servo,transport_delay | actuator_lag,1" in confusion
    effects = (tmp_path / "effects.csv").read_text(encoding="utf-8").splitlines()
    assert effects[1:] == [
        "slow servo,yes,six,still,1,1,0.207,1.000,0,0,0.000,0.793,0,0,0.100",
        "slow servo,yes,two,still,1,0,0.000,0.793,1,0,0.000,0.793,0,0,",
    ]
    assert "10,11,0.5,+0.100" in (tmp_path / "sizes.csv").read_text(encoding="utf-8")
    assert len((tmp_path / "cases.csv").read_text(encoding="utf-8").splitlines()) == 4
    assert "## What stands against a name" not in page  # nobody has looked
    parts = (tmp_path / "parts.csv").read_text(encoding="utf-8").splitlines()
    assert parts[1:3] == [
        "one effect,2,0.342,1.000,1,2",
        "two effects,0,0.000,1.000,0,0",
    ]  # a delay is of the same part
    assert "| set | 1 of 1 | 21 to 100 % | 1 of 1 |" in page
