"""After the flight: runs found in logs by what was commanded, and set against their cards."""

from dataclasses import replace

import numpy as np
import pytest
from commands import command
from test_bounds import CONTENT

from testbench.core.errors import RecordError
from testbench.core.record import FlightRecord
from testbench.questions.plan.ask import make_plan
from testbench.questions.plan.close import close_plan
from testbench.questions.plan.close_answer import close_answer
from testbench.questions.plan.flown_card import FlownCard
from testbench.questions.plan.scenario import PlanScenario
from testbench.questions.plan.verdicts import causes_of, judge

RATE_HZ = 50.0
CHANNELS = ("V", "alpha", "q", "az", "beta", "p", "r", "phi", "de_cmd", "da_cmd", "dr_cmd")
MANOEUVRES = [
    {"name": "elevator", "duration_s": 6.0, "repeats": 2,
     "input": [{"signal": "3211", "control": "de", "amplitude_deg": 2.0, "step_s": 0.4, "start_s": 0.5}]},
    {"name": "aileron", "duration_s": 5.0, "repeats": 1,
     "input": [{"signal": "doublet", "control": "da", "amplitude_deg": 2.0, "period_s": 1.6, "start_s": 0.5}]},
]  # fmt: skip


@pytest.fixture(scope="module")
def plan():
    """Two manoeuvres at two speeds, in air that the bands allow for."""
    content = {**CONTENT, "manoeuvre": MANOEUVRES, "speeds_m_s": [13.0, 15.0], "turbulence_rms_m_s": 0.3}
    return make_plan(PlanScenario.model_validate(content))


def log_of(parts, seed=0, rate_hz=RATE_HZ):
    """A log of runs one after the other with quiet flight between: (card, factor on what was commanded)."""
    rng, columns = np.random.default_rng(seed), {name: [] for name in CHANNELS}
    for card, factor in parts:
        t = np.arange(-4.0, card.spec.duration_s, 1.0 / rate_hz)
        for name in CHANNELS:
            if name.endswith("_cmd"):
                bare = name.removesuffix("_cmd")
                u = np.zeros(t.size)
                if bare in card.signal.channels:
                    rows = np.clip((t / card.signal.dt_s + 1e-6).astype(int), 0, len(card.signal.u) - 1)
                    u = np.where(t >= 0.0, factor * card.signal.u[rows, card.signal.channels.index(bare)], 0.0)
                columns[name].append(card.point.trimmed.controls[bare] + u)
            else:
                y = np.interp(t, card.t_s, card.expected[name])
                columns[name].append(y + 1e-4 * rng.standard_normal(t.size))
    data = np.column_stack([np.concatenate(columns[name]) for name in CHANNELS])
    return FlightRecord(np.arange(len(data)) / rate_hz, CHANNELS, data, "measured")


def judged(closed):
    """The campaign with nothing identified."""
    return judge(closed, [FlownCard(c, tuple(closed.good(c)), None, False) for c in closed.plan.cards])


def test_every_run_is_found_where_it_was_flown_and_at_its_speed(plan):
    slow, slow_da, fast, fast_da = plan.cards
    order = [slow, fast, slow_da, slow, fast_da, fast]
    closed = close_plan(plan, [("one.bin", log_of([(c, 1.0) for c in order]))])
    assert [r.card.number for r in closed.runs] == [1, 1, 2, 3, 3, 4]
    assert all(not r.faults for r in closed.runs), [r.faults for r in closed.runs]
    assert all(r.likeness > 0.99 for r in closed.runs)
    begin = 0.0
    for card in order:
        starts = [r.start_s for r in closed.of(card)]
        assert min(abs(s - begin - 4.0) for s in starts) < 0.021
        begin += 4.0 + card.spec.duration_s
    assert judged(closed).following is None
    assert [*close_answer(judged(closed))][-1] == ("finding", "all planned runs are flown")
    first = closed.runs[0].record
    assert first.duration_s == pytest.approx(slow.spec.settle_s + slow.spec.duration_s - 0.02, abs=0.021)


def test_what_is_missing_and_what_comes_next(plan):
    slow, slow_da, fast, _ = plan.cards
    one, two = log_of([(slow, 1.0)]), log_of([(slow_da, 1.0), (fast, 1.0)], seed=1)
    closed = close_plan(plan, [("one.bin", one), ("two.bin", two)])
    assert [(r.card.number, r.log) for r in closed.runs] == [(1, "one.bin"), (2, "two.bin"), (3, "two.bin")]
    assert [closed.missing(c) for c in plan.cards] == [1, 0, 1, 1]
    said = dict(close_answer(judged(closed)))
    assert judged(closed).following.card is slow
    assert said["lead"] == "nothing found, from 3 good of 6 planned runs"
    assert ("finding", "3 runs of 6 found in 2 logs, 3 as their cards say") in close_answer(judged(closed))
    assert any("not flown: card 4" in text for _, text in close_answer(judged(closed)))
    assert said["finding"].startswith("next is card 1")


def test_a_run_that_is_not_as_its_card_says_must_be_repeated(plan):
    slow = plan.cards[0]
    weak = log_of([(slow, 0.6)])
    quick = log_of([(slow, 1.0)])
    quick = quick.with_columns({"V": quick["V"] + 0.9})
    rough = log_of([(slow, 1.0)])
    rough = rough.with_columns({"q": 3.0 * rough["q"]})
    hard = log_of([(slow, 1.0)])
    hard = hard.with_columns({"az": np.where(hard.t_s > 6.0, -25.0, hard["az"])})
    off = log_of([(slow, 1.0)])
    off = off.with_columns({"V": off["V"] + 4.0})
    window = plan.scenario.autopilot.speed_window_m_s
    for record, words, unexpected in (
        (weak, "the command was not the card's", False),
        (hard, "the load factor passes 2", True),
    ):
        (run,) = close_plan(plan, [("x", record)]).runs
        assert run.unexpected is unexpected
        assert any(words in fault for fault in run.faults), (words, run.faults)
    (run,) = close_plan(plan, [("x", rough)]).runs  # the aircraft is not as believed, which is what was asked
    assert (run.faults, run.strange, run.unexpected, run.anomalies) == ((), ("q",), True, ())
    (run,) = close_plan(plan, [("x", quick)]).runs
    assert run.card is slow  # 13.9 m/s is nearer to 13 than to 15
    assert not run.faults
    (run,) = close_plan(plan, [("x", off)]).runs
    assert run.card is plan.cards[2]  # 17 m/s
    assert run.V_m_s == pytest.approx(17.0, abs=0.1)
    for beyond, said in ((1.9, False), (2.1, True)):
        fast = log_of([(plan.cards[2], 1.0)])
        fast = fast.with_columns({"V": fast["V"] + beyond * window})
        (run,) = close_plan(plan, [("x", fast)]).runs
        assert any("it began at" in fault for fault in run.faults) is said


@pytest.mark.parametrize(
    ("factor", "words"), [(-1.0, "q responds with the opposite sign"), (57.3, "check its unit (deg for rad)")]
)
def test_what_no_aircraft_explains_means_no_go(plan, factor, words):
    log = log_of([(plan.cards[0], 1.0)])
    closed = close_plan(plan, [("x", log.with_columns({"q": factor * log["q"]}))])
    assert words in closed.runs[0].anomalies[0]
    campaign = judged(closed)
    assert campaign.following is None
    assert all(words in c.go for c in campaign.cards)
    assert any(words in text for _, text in close_answer(campaign))


def test_where_nothing_is_found_the_cause_is_named(plan):
    log = log_of([(plan.cards[0], 1.0)])
    closed = close_plan(plan, [("x", log.with_columns({"de_cmd": 57.3 * log["de_cmd"]}))])
    assert closed.runs == ()
    assert any(
        "57.3 times as far as card 1 commands: check its unit" in text for _, text in close_answer(judged(closed))
    )


def test_two_controls_are_one_run_and_each_has_its_sign():
    doublet = {"signal": "doublet", "amplitude_deg": 1.5, "period_s": 1.6}
    entries = [{**doublet, "control": "da", "start_s": 0.5}, {**doublet, "control": "dr", "start_s": 2.5}]
    both = {"name": "both", "duration_s": 5.0, "repeats": 2, "input": entries}
    plan = make_plan(PlanScenario.model_validate({**CONTENT, "manoeuvre": [both], "speeds_m_s": [13.0]}))
    (card,) = plan.cards
    log = log_of([(card, 1.0), (card, 1.0)])
    assert [r.faults for r in close_plan(plan, [("x", log)]).runs] == [(), ()]
    dr, half = np.array(log["dr_cmd"]), len(log) // 2
    turned = np.where(np.arange(dr.size) < half, 2.0 * dr[0] - dr, dr)
    first, second = close_plan(plan, [("x", log.with_columns({"dr_cmd": turned}))]).runs
    assert first.gain == pytest.approx(-1.0, abs=0.05)
    assert "other sign" in first.faults[0]
    assert not second.faults
    assert close_plan(plan, [("x", log.with_columns({"da_cmd": np.zeros(dr.size)}))]).runs[0].faults


def test_a_command_that_rests_at_an_extreme_where_the_card_goes_beyond_is_saturated():
    sweep = {
        "signal": "sweep",
        "control": "de",
        "amplitude_deg": 1.5,
        "f_start_hz": 0.3,
        "f_end_hz": 2.0,
        "sweep_s": 6.0,
    }
    swept = {"name": "sweep", "duration_s": 7.0, "repeats": 1, "input": [sweep]}
    plan = make_plan(PlanScenario.model_validate({**CONTENT, "manoeuvre": [swept], "speeds_m_s": [13.0]}))
    log = log_of([(plan.cards[0], 1.0)])
    de = log["de_cmd"]
    for low, high, saturated in ((-1.0, 1.0, False), (-1.0, 0.7, True), (-0.7, 1.0, True)):
        held = np.clip(de, de[0] + low * np.ptp(de) / 2.0, de[0] + high * np.ptp(de) / 2.0)
        closed = close_plan(plan, [("x", log.with_columns({"de_cmd": held}))])
        said = [*causes_of(closed, FlownCard(plan.cards[0], closed.runs, None, False))]
        assert any(text.startswith("de stayed at an extreme") for text in said) is saturated


def test_quiet_flight_and_noise_are_no_runs_and_dropouts_no_faults(plan):
    slow = plan.cards[0]
    record = log_of([(slow, 0.0)])
    rng = np.random.default_rng(3)
    noisy = record.with_columns({"de_cmd": record["de_cmd"] + 0.002 * rng.standard_normal(len(record))})
    for quiet in (record, noisy):
        closed = close_plan(plan, [("x", quiet)])
        assert not closed.runs
        assert judged(closed).following.card is slow
    full = log_of([(slow, 1.0)])
    marks, data = np.ones(full.data.shape, bool), np.array(full.data)
    lost = CHANNELS.index("q")
    marks[300:340, lost], data[300:340, lost] = False, data[299, lost]  # a dropout in the middle of the run
    (run,) = close_plan(plan, [("x", replace(full, data=data, valid=marks))]).runs
    assert not run.faults
    with pytest.raises(RecordError, match="must hold a control of its cards"):
        close_plan(plan, [("x", record.select(["V", "q"]))])


def test_the_command_reads_a_log_and_writes_what_it_found(plan, tmp_path):
    file = tmp_path / "plan.toml"
    lines = [
        f'{k} = "{v}"' if isinstance(v, str) else f"{k} = {v}" for k, v in CONTENT.items() if not isinstance(v, dict)
    ]
    lines += ["turbulence_rms_m_s = 0.3", "[limits]", "[timing]", "turn_s = 30.0", "overhead_s = 60.0", "[energy]"]
    lines += ['kind = "battery"', "capacity_Wh = 20.0", "efficiency_percent = 50.0", 'source = "made up"']
    for m in MANOEUVRES[:1]:
        (entry,) = m["input"]
        lines += ["[[manoeuvre]]", f'name = "{m["name"]}"', f"duration_s = {m['duration_s']}", "repeats = 2"]
        lines += ["[[manoeuvre.input]]"]
        lines += [f'{k} = "{v}"' if isinstance(v, str) else f"{k} = {v}" for k, v in entry.items()]
    text = "\n".join(lines).replace("speeds_m_s = [14.0]", "speeds_m_s = [13.0]")
    file.write_text(text, encoding="utf-8")
    log = tmp_path / "flight.csv"
    log_of([(plan.cards[0], 1.0)]).save_csv(log)
    done = command("plan", "close", file, log, "-o", tmp_path)
    assert done.returncode == 0, done.stderr
    assert "1 run of 2 found in 1 log" in done.stdout
    assert len(list((tmp_path / "close_plan" / "records").glob("*_run_1.nc"))) == 1
    assert (tmp_path / "close_plan" / "report.html").is_file()
    assert "testbench identify" in done.stdout
    quiet = tmp_path / "quiet.csv"
    quiet.write_text("\n".join(log.read_text("utf-8").splitlines()[:25]) + "\n", "utf-8")
    none = command("plan", "close", file, quiet, "-o", tmp_path / "none")
    assert none.returncode == 0, none.stderr  # the page has a table of runs without a row
    assert "0 runs of 2 found in 1 log" in none.stdout
    other = tmp_path / "other.csv"
    other.write_text("t [s],q [rad/s]\n" + "\n".join(f"{0.02 * i},{0.01 * (i % 7)}" for i in range(200)), "utf-8")
    strange = command("plan", "close", file, other, "-o", tmp_path)
    assert strange.returncode == 2
    assert "must hold a control of its cards (de_cmd), got none in other.csv" in strange.stderr.replace("\n", " ")
    lost = command("plan", "close", file, tmp_path / "nothing.bin", "-o", tmp_path)
    assert lost.returncode == 2
    assert "Traceback" not in lost.stderr
