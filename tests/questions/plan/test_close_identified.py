"""A simulated campaign after its flights: runs identified as designed, promises kept or broken, what comes next."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from flown_campaign import NAMES, SENSORS, flown_campaign, promise_of
from plain_fits import plain_fits
from writers import dataflash_of, ulog_of

from testbench.core.errors import RecordError, ScenarioError
from testbench.design.realise import Errors, Realised
from testbench.evaluation.modes import modes_of
from testbench.questions.design.ready import promise_text, read_promise
from testbench.questions.identify.ask import identify
from testbench.questions.identify.scenario import RecordDescription
from testbench.questions.importing.ask import import_log
from testbench.questions.plan.close import close_plan
from testbench.questions.plan.close_answer import close_answer
from testbench.questions.plan.close_page import close_page
from testbench.questions.plan.flown_card import identify_cards
from testbench.questions.plan.flown_recipe import recipe_of
from testbench.questions.plan.rehearse import AFTER_S, QUIET_S, rehearse
from testbench.questions.plan.verdicts import judge, more_runs

pytestmark = pytest.mark.usefixtures("plain_fits")


@pytest.fixture(scope="module", params=[True, pytest.param(False, marks=pytest.mark.slow)], ids=["plain", "mended"])
def flown(request, tmp_path_factory):
    """A plan with a designed elevator input at two speeds and an aileron doublet, its log, and what was found."""
    with plain_fits(request.param):
        return flown_campaign(tmp_path_factory.mktemp("campaign"))


def of_cards(plan, log, *numbers):
    """The log with the runs of some cards alone."""
    starts, at = [], 0.0
    for run in plan.runs:
        length = QUIET_S + run.card.length_s + AFTER_S
        starts.append((run.card.number, at, at + length))
        at += length
    parts = [log.between(a, b) for n, a, b in starts if n in numbers]
    data = np.concatenate([p.data for p in parts])
    return replace(log, t_s=log.dt_s * np.arange(len(data)), data=data, valid=np.ones(data.shape, bool))


def test_cards_are_identified_as_designed_and_keep_their_promise(flown):
    plan, _, closed, cards, folder = flown
    assert [len(closed.good(c)) for c in plan.cards] == [2, 1, 2]
    assert all(not r.faults for r in closed.runs), [r.faults for r in closed.runs]
    campaign = judge(closed, cards)
    first, aileron, fast = campaign.cards
    assert first.flown.recipe.design == folder / "designs" / "1_x.toml"
    for card in (first, fast):
        assert [t.name for t in card.targets] == list(NAMES)
        assert [t.verdict for t in card.targets] == ["reached"] * 3
        for t in card.targets:  # alpha and q at constant speed are up to 6 % off in a flight without noise
            assert abs(t.estimate.value - t.here) < 3.0 * math.hypot(t.estimate.stated, 0.06 * t.here), t
        assert all(0.0 < t.error < 0.08 * abs(t.believed) for t in card.targets)  # two runs: less than promised of one
        for k, t in enumerate(card.targets):  # simulated flights of the promise have no error that lasts
            rms, (low, high) = card.flown.promise.realised.found.rms[k], card.flown.promise.realised.found.interval()
            assert t.realised == pytest.approx([x / math.sqrt(2.0) for x in (rms, low[k], high[k])])
        assert all(t.promised == pytest.approx(0.1 * abs(t.believed) / math.sqrt(2.0)) for t in card.targets)
    assert any("its design is for 13 m/s" in note for note in fast.flown.notes)
    assert fast.targets[0].here / first.targets[0].here == pytest.approx((15.0 / 13.0) ** 2, rel=0.03)
    assert aileron.flown.recipe.design is None
    assert {t.verdict for t in aileron.targets} <= {"found", "not identifiable"}
    assert next(t for t in aileron.targets if t.name == "L_p").verdict == "found"
    assert campaign.following is None
    page = close_page(campaign)
    assert {p.name for p in page.plates} == {"errors"}
    assert any("known as well as promised" in text for _, text in close_answer(campaign))
    assert [*close_answer(campaign)][-1] == ("finding", "all planned runs are flown")


def test_the_description_identifies_the_same_again(flown):
    *_, cards, _ = flown
    first = cards[0]
    again = identify(RecordDescription.load(first.file))
    assert len(again.flights) == 2
    for d in again.derivatives:
        if d.name in NAMES:
            assert d.value == pytest.approx(first.estimates[d.name].value, rel=1e-9)
            assert d.std == pytest.approx(first.estimates[d.name].stated, rel=1e-6)


def test_frequency_and_damping_are_targets_too(flown, tmp_path):
    plan, _, closed, _, folder = flown
    card, file = plan.cards[0], folder / "promises" / "1_x.json"
    pole = modes_of(card.point.model, plan.aircraft, "longitudinal")["short period"]
    text, promise = file.read_text(encoding="utf-8"), promise_of(card, 0.3, realised=False)
    names, values = ("wn of short period", "zeta of short period"), np.array([abs(pole), -pole.real / abs(pole)])
    told = replace(promise, names=names, values=values, wanted=0.3 * values, promised=0.3 * values)
    file.write_text(promise_text(replace(told, modes={"short period": pole})), encoding="utf-8")
    alone = replace(closed, plan=replace(plan, cards=(card,)), runs=tuple(closed.of(card)))
    cards = identify_cards(alone, tmp_path)
    file.write_text(text, encoding="utf-8")
    wn, zeta = judge(alone, cards).cards[0].targets
    (mode,) = [m for m in cards[0].case.model.modes() if abs(m.wn_rad_s - wn.estimate.value) < 1e-6]
    assert wn.estimate.stated == pytest.approx(mode.wn_std, rel=1e-3)
    assert (zeta.estimate.value, zeta.estimate.stated) == pytest.approx((mode.zeta, mode.zeta_std), rel=1e-3)
    assert abs(wn.estimate.value / wn.here - 1.0) < 0.15
    assert (wn.verdict, zeta.verdict) == ("reached", "reached")


def with_promise(card, **promise):
    return replace(card, promise=promise_of(card.card, **promise))


def test_a_broken_promise_says_why_and_how_many_more_runs(flown):
    plan, _, closed, cards, _ = flown
    tight = with_promise(cards[0], share=0.001, realised=False, wanted=0.005)
    card = judge(closed, [tight, *cards[1:]]).cards[0]
    found = next(t for t in card.targets if t.name == "M_q")
    assert found.verdict == "not reached"
    if found.more is not None:
        left = math.hypot(found.estimate.error / math.sqrt((2 + found.more) / 2), tight.bends["M_q"])
        assert left <= found.wanted * 1.001
    believed = {t.name: t for t in card.targets}
    assert all(t.allowed < 0.05 * abs(t.believed) for t in believed.values())
    lasting = with_promise(cards[0], share=0.02, wanted=0.05, bias=0.2)  # simulated flights are 20 % off
    card = judge(closed, [lasting, *cards[1:]]).cards[0]
    assert all(t.more is None for t in card.targets)
    assert all(t.error > 0.19 * abs(t.believed) for t in card.targets)
    campaign = judge(closed, [lasting, *cards[1:]])
    assert any("design another input" in text for _, text in close_answer(campaign))
    alone = "(card 1) the estimator alone states"
    (told,) = [text for _, text in close_answer(campaign) if alone in text]
    assert "estimates in simulated flights of the design" in told
    assert "have a mean error of" in told
    assert plan.cards[0] is card.card


def test_runs_that_scatter_by_more_than_their_errors_widen_them(flown, tmp_path):
    plan, log, *_ = flown
    one = of_cards(plan, log, 1)
    half = len(one) // 2
    q = np.array(one["q"])
    trim = q[:150].mean()
    q[half:] = trim + 1.3 * (q[half:] - trim)  # the second run answers by three tenths more
    closed = close_plan(plan, [("x", one.with_columns({"q": q}))])
    bent = replace(closed, runs=tuple(replace(r, faults=()) for r in closed.runs))
    card = identify_cards(bent, tmp_path)[0]
    assert max(e.scatter for e in card.estimates.values()) > 2.0


def ardupilot(log, full):
    """The log as ArduPilot writes it; the elevator's servo has 400 microseconds on either side."""
    formats = ((130, "IMU", "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"), (131, "ATT", "Qfff",
               "TimeUS,Roll,Pitch,Yaw"), (132, "ARSP", "Qff", "TimeUS,Airspeed,DiffPress"), (133, "RCOU", "QHHHH",
               "TimeUS,C1,C2,C3,C4"), (134, "PARM", "QNf", "TimeUS,Name,Value"), (136, "AOA", "Qff", "TimeUS,AOA,SSA")
               )  # fmt: skip
    messages = [("PARM", (0, f"SERVO2_{k}".encode(), float(v))) for k, v in
                {"FUNCTION": 19, "MIN": 1100, "TRIM": 1500, "MAX": 1900, "REVERSED": 1}.items()]  # fmt: skip
    c = {n: log[n].tolist() for n in log.channels}
    for i, t in enumerate((12.5e6 + 1e6 * log.t_s).round().astype(int).tolist()):
        messages += [
            ("IMU", (t, 0, c["p"][i], c["q"][i], c["r"][i], 0.3, 0.1, c["az"][i])),
            ("ATT", (t, *(math.degrees(c[n][i]) for n in ("phi", "theta")), 90.0)),
            ("ARSP", (t, c["V"][i], 100.0)),
            ("RCOU", (t, 1500, round(1500 + 400 * c["de_cmd"][i] / full), 1300, 1500)),
            ("AOA", (t, math.degrees(c["alpha"][i]), math.degrees(c["beta"][i]))),
        ]
    return dataflash_of(formats, messages)


def px4(log, full):
    """The log as PX4 writes it, without a vane: no angle of attack."""
    clock = "uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;"
    zero = np.zeros(len(log))
    half = 0.5 * np.array([log["phi"], log["theta"]])
    (c1, c2), (s1, s2) = np.cos(half), np.sin(half)
    topics = {
        "vehicle_angular_velocity": (clock, [log["p"], log["q"], log["r"]]),
        "vehicle_attitude": ("uint64_t timestamp;uint64_t timestamp_sample;float[4] q;",
                             [c1 * c2, s1 * c2, c1 * s2, -s1 * s2]),
        "vehicle_acceleration": (clock, [zero + 0.3, zero, log["az"]]),
        "airspeed_validated": ("uint64_t timestamp;float true_airspeed_m_s;", [log["V"]]),
        "vehicle_torque_setpoint": (clock, [zero, -log["de_cmd"] / full, zero]),
    }  # fmt: skip
    return ulog_of([(n, f, log.t_s, np.column_stack(v)) for n, (f, v) in topics.items()])


@pytest.mark.parametrize("writer", [ardupilot, px4])
def test_the_logs_of_both_autopilots_say_the_same(flown, tmp_path, writer):
    plan, log, closed, cards, _ = flown
    full = plan.aircraft.controls["de"].full
    file = tmp_path / ("flight.bin" if writer is ardupilot else "flight.ulg")
    file.write_bytes(writer(of_cards(plan, log, 1), full))
    record = import_log(file, throw_rad={"de": full}).record
    again = close_plan(plan, [(file.name, record)])
    assert [r.card.number for r in again.runs] == [1, 1]
    assert all(r.gain == pytest.approx(1.0, abs=0.02) for r in again.runs)
    found = identify_cards(again, tmp_path)[0]
    assert found.recipe.missing == (() if writer is ardupilot else ("alpha",))
    campaign = judge(again, [found, *cards[1:]])
    if writer is ardupilot:
        for name in NAMES:
            here, there = found.estimates[name], cards[0].estimates[name]
            assert abs(here.value - there.value) < 2.0 * math.hypot(here.error, there.error)
        return
    for t in campaign.cards[0].targets:  # of pitch rate alone: less is known, and the cause is named
        assert t.verdict == "reached" or any("alpha" in why for why in t.causes), (t.name, t.verdict, t.causes)
    assert campaign.following.card.number == 2
    assert closed.plan is plan


def test_a_log_without_a_gyro_is_not_identified_and_says_so(flown, tmp_path):
    plan, log, _, _, _ = flown
    blind = log.select([n for n in log.channels if n not in ("p", "q", "theta")])
    closed = close_plan(plan, [("x", blind)])
    cards = identify_cards(closed, tmp_path)
    assert cards[0].recipe.missing == ("q",)
    assert "derivatives of the lateral motion need p, r and V in the log, got" in cards[1].reason
    campaign = judge(closed, cards)
    for t in campaign.cards[0].targets:
        assert t.verdict == "reached" or "not logged: q" in " ".join(t.causes)
    assert all(t.verdict == "not identifiable" for t in campaign.cards[1].targets)
    assert any("need p, r and V" in text for _, text in close_answer(campaign))


def test_broken_off_turned_weak_and_missing_runs_are_told_apart(flown, tmp_path):
    plan, log, _, cards, _ = flown
    one = of_cards(plan, log, 1)
    trim, half, length = one["de_cmd"][0], len(one) // 2, plan.cards[0].length_s
    de = np.array(one["de_cmd"])
    turned = np.where(np.arange(de.size) < half, 2.0 * trim - de, de)
    runs = close_plan(plan, [("x", one.with_columns({"de_cmd": turned}))]).runs
    assert [round(r.gain, 2) for r in runs] == [-1.0, 1.0]
    assert "other sign" in runs[0].faults[0]
    assert not runs[1].faults
    for after_s in (0.62, 0.75, 0.85):  # the switch goes low in the middle of the sequence
        stop = one.t_s > QUIET_S + plan.cards[0].spec.settle_s + after_s
        stopped = np.where(stop & (np.arange(de.size) < half), trim, de)
        runs = close_plan(plan, [("x", one.with_columns({"de_cmd": stopped}))]).runs
        assert [r.broken_s is None for r in runs] == [False, True]
        assert runs[0].broken_s == pytest.approx(after_s, abs=0.15)
        assert "aborted after" in runs[0].faults[0]
    second_s = QUIET_S + length + AFTER_S + QUIET_S + plan.cards[0].spec.settle_s
    ends = one.between(0.0, second_s + 0.8)  # within the second run
    runs = close_plan(plan, [("x", ends)]).runs
    assert [r.broken_s is None for r in runs] == [True, False]
    closed = close_plan(plan, [("x", ends)])
    campaign = judge(closed, [replace(c, runs=tuple(closed.good(c.card))) for c in cards])
    assert campaign.cards[0].missing == 1
    assert campaign.following.card.number == 2  # never flown: the largest lack of what may be flown
    assert "at a lower speed come first" in campaign.cards[2].go
    assert any(text.startswith("NO-GO for card 3") for _, text in close_answer(campaign))
    weak = close_plan(plan, [("x", one.with_columns({"de_cmd": trim + 0.4 * (de - trim)}))]).runs
    assert [round(r.gain, 2) for r in weak] == [0.4, 0.4]
    assert all("40 % of its amplitude" in r.faults[0] for r in weak)
    hand = one.with_columns({"de_cmd": trim + 0.03 * np.sin(0.7 * one.t_s)})  # a pilot who trims
    assert not close_plan(plan, [("x", hand)]).runs
    nothing = identify_cards(close_plan(plan, [("x", hand)]), tmp_path)
    assert all(c.reason == "no run was flown as on the card" for c in nothing)


def test_a_lost_design_and_a_damaged_promise_are_said(flown, tmp_path):
    plan, _, closed, _, folder = flown
    promise = folder / "promises" / "1_x.json"
    text = promise.read_text(encoding="utf-8")
    assert read_promise(folder / "designs" / "1_x.toml").names == NAMES
    assert read_promise(tmp_path / "designs" / "none.toml") is None
    for bad in ("{", json.dumps({**json.loads(text), "believed": [1.0]}), "[]"):
        promise.write_text(bad, encoding="utf-8")
        with pytest.raises(RecordError, match=r"a promise in JSON, but it is damaged|as `testbench design` writes it"):
            read_promise(folder / "designs" / "1_x.toml")
    promise.write_text(text, encoding="utf-8")
    kept = read_promise(folder / "designs" / "1_x.toml")
    assert promise_text(kept) == text
    card = replace(plan.cards[0], spec=plan.cards[0].spec.model_copy(update={"design": "gone/designs/2.toml"}))
    recipe = recipe_of(plan, card, [r.record for r in closed.of(plan.cards[0])])
    assert recipe.design is None
    assert "gone/designs/2.toml was not found" in recipe.notes[0]
    assert recipe.identification["estimators"][0]["structure"] == "longitudinal"
    broken = folder / "broken.toml"
    card = replace(card, spec=card.spec.model_copy(update={"design": str(broken)}))
    for bad, words in (
        ("[identification", "must be TOML"),
        ('[[identification.estimators]]\nstructure = "longitudinal"', "must be as `testbench design` writes it"),
        ("identification = 3", "must be as `testbench design` writes it"),
    ):
        broken.write_text(bad, encoding="utf-8")
        with pytest.raises((RecordError, ScenarioError), match=words):
            recipe_of(plan, card, [r.record for r in closed.of(plan.cards[0])])


def test_equations_of_a_design_are_driven_by_what_was_logged(flown):
    plan, log, closed, _, folder = flown
    design = folder / "written.toml"
    design.write_text(
        """
[identification]
inputs = ["de"]
[identification.structures.mine]
states = ["alpha", "q"]
inputs = ["de"]
equations = { alpha_dot = "Z_alpha*alpha + q", q_dot = "M_alpha*alpha + M_q*q + M_de*de" }
parameters = { Z_alpha = -5.0, M_alpha = -50.0, M_q = -9.0, M_de = -60.0 }
[[identification.estimators]]
method = "output_error"
structure = "mine"
outputs = ["alpha", "q", "theta_is_not_one"]
output_biases = ["alpha", "theta_is_not_one"]
""",
        encoding="utf-8",
    )
    card = replace(plan.cards[0], spec=plan.cards[0].spec.model_copy(update={"design": str(design)}))
    records = [r.record for r in closed.good(plan.cards[0])]
    recipe = recipe_of(plan, card, records)
    told = recipe.identification
    assert told["inputs"] == ["de_cmd"]
    assert told["structures"]["mine"]["equations"]["q_dot"] == "M_alpha*alpha + M_q*q + M_de*de_cmd"
    assert told["structures"]["mine"]["inputs"] == ["de_cmd"]
    assert told["estimators"][0]["outputs"] == ["alpha", "q"]
    assert told["estimators"][0]["output_biases"] == ["alpha"]
    assert recipe.missing == ("theta_is_not_one",)
    assert "through the servo of taurus" in recipe.notes[0]
    sensed = [r.with_columns({"de": r["de_cmd"]}) for r in records]
    assert recipe_of(plan, card, sensed).identification["inputs"] == ["de"]
    with pytest.raises(RecordError, match="got no alpha, q and theta_is_not_one"):
        recipe_of(plan, card, [r.select(["V", "de_cmd"]) for r in records])
    assert "de_cmd" in log


def test_what_lasts_and_what_exceeds_is_told_from_chance():
    """Of right promises 1 % are called biased and 1 % too small: of 400, 12 or more by chance of 0.2 %."""
    rng = np.random.default_rng(5)
    stated = np.full((20, 400), 2.0)
    errors = 2.0 * rng.standard_normal((20, 400))
    right = Realised(np.full(400, 2.0), Errors(errors, stated, ()), np.zeros(400, bool))
    assert sum(right.found.lasting(k) > 0.0 for k in range(400)) < 12
    assert sum(right.found.excess(k) > 1.0 for k in range(400)) < 12
    off = replace(right, found=Errors(3.0 * errors + 9.0, stated, ()))
    assert np.median([off.found.lasting(k) for k in range(400)]) == pytest.approx(9.0, rel=0.1)
    assert np.median([off.found.excess(k) for k in range(400)]) == pytest.approx(3.0, rel=0.1)
    assert more_runs(2.0, 1.0, 3, 0.0) == 9  # errors fall with the root of the number of runs
    assert more_runs(0.9, 1.0, 3, 0.0) == 0
    assert more_runs(math.hypot(2.0, 0.6), 1.0, 1, 0.6) == 6  # (2 / 0.8)^2 = 6.25 runs
    assert more_runs(2.0, 1.0, 1, 1.0) is None
    assert more_runs(100.0, 1.0, 1, 0.0) is None


def test_a_rehearsal_is_the_runs_one_after_the_other_and_repeats_itself(flown):
    plan, log, *_ = flown
    assert len(log) == round(sum(QUIET_S + r.card.length_s + AFTER_S for r in plan.runs) / log.dt_s)
    assert set(log.channels) == {*SENSORS, "de_cmd", "da_cmd", "dr_cmd", "thr_cmd"}
    (again,) = rehearse(plan, seed=5).values()
    np.testing.assert_array_equal(again.data, log.data)
    (other,) = rehearse(plan, seed=6).values()
    assert np.abs(other["q"] - log["q"]).max() > 0.0


def test_a_rehearsed_run_that_meets_a_limit_of_the_aircraft_is_broken_off_there(flown):
    plan, log, *_ = flown
    p = float(np.abs(log["p"]).max())  # of the aileron doublet
    narrow = replace(plan.aircraft, limits={**plan.aircraft.limits, "p": (-0.95 * p, 0.95 * p)})
    said = []
    (short,) = rehearse(plan, narrow, seed=5, say=said.append).values()
    told = [text for text in said if "is aborted" in text]
    assert len(told) == 1
    assert "p <=" in told[0]
    assert 0 < len(log) - len(short) < round((max(r.card.length_s for r in plan.runs) + AFTER_S) / log.dt_s)
    runs = close_plan(plan, [("log", short)]).runs
    assert [r.card.spec.name for r in runs if r.broken_s is not None] == ["aileron"]
