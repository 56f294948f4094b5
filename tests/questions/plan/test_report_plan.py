"""The report of a flight plan: the Taurus campaign through the command line, its cards, pages and signals."""

import csv
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from commands import command
from quick_drawing import on_paper
from typer.testing import CliRunner

from testbench.cli import app
from testbench.core.errors import RecordError
from testbench.core.paths import SCENARIOS
from testbench.evaluation.envelope import fly_envelope
from testbench.page import draw
from testbench.page.figure import Area, Curve, Rule, Words
from testbench.questions.plan import ask
from testbench.questions.plan.answer import plan_answer
from testbench.questions.plan.ask import make_plan
from testbench.questions.plan.card_figures import card_page, kneeboard_page
from testbench.questions.plan.card_text import beyond_limits, card_stem, card_text, levels, sequence_lines, standing
from testbench.questions.plan.page import modes_table, plan_page, points_table, runs_table, short_cards, write_cards
from testbench.questions.plan.result import read_cleared
from testbench.questions.plan.scenario import Autopilot, Fuel, OnTheCard, PlanScenario


@pytest.fixture(scope="module")
def taurus_plan():
    return make_plan(PlanScenario.load(SCENARIOS / "plan" / "taurus_63.toml"), fly_envelope)


@pytest.fixture(scope="module")
def eolo_plan():
    """Two speeds of the build-up of EOLO."""
    base = PlanScenario.load(SCENARIOS / "plan" / "eolo_envelope.toml")
    return make_plan(base.model_copy(update={"speeds_m_s": (18.0, 19.0)}), fly_envelope)


@pytest.fixture(scope="module")
def written(taurus_plan, tmp_path_factory):
    """What the command line makes of the Taurus campaign, which is made once: (how it ended, folder)."""
    out = tmp_path_factory.mktemp("plan")
    with on_paper(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(ask, "make_plan", lambda scenario, *more, **named: taurus_plan)
        patch.setenv("COLUMNS", "200")
        return CliRunner().invoke(app, ["plan", "taurus_63", "-o", str(out)]), out / "plan_taurus_63"


def test_the_campaign_of_the_paper_has_63_runs(written):
    done, folder = written
    assert done.exit_code == 0, done.output
    assert "63 runs (37 longitudinal, 26 lateral)" in done.output
    with (folder / "plan.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [int(r["run"]) for r in rows] == list(range(1, 64))
    assert sum(r["plane"] == "longitudinal" for r in rows) == 37
    content = json.loads((folder / "plan.json").read_text(encoding="utf-8"))
    assert len(content["rows"]) == 63


def test_every_card_is_one_page_a4_and_a_page_of_its_own(written, taurus_plan):
    _, folder = written
    assert len(taurus_plan.cards) == 7
    for card in taurus_plan.cards:
        stem = card_stem(card)
        pdf = (folder / "cards" / f"{stem}.pdf").read_bytes()
        assert len(re.findall(rb"/Type /Page\b", pdf)) == 1
        box = [float(x) for x in re.search(rb"/MediaBox \[([^\]]*)\]", pdf)[1].split()]
        np.testing.assert_allclose(box, [0.0, 0.0, 595.3, 841.9], atol=0.5)  # A4 in points
        html = (folder / "cards" / f"{stem}.html").read_text(encoding="utf-8")
        assert card.title[1:] in html
        for part in ("Set-up", "Limits, and the action when one is met", "Control sequence", "Go or no-go", "Log"):
            assert part in html
        assert "http://" not in html.replace("http://www.w3.org", "")
        assert (folder / "signals" / f"{stem}.csv").stat().st_size > 100
    assert len(re.findall(rb"/Type /Page\b", (folder / "cards.pdf").read_bytes())) == 7
    knees = (folder / "kneeboard.pdf").read_bytes()
    assert len(re.findall(rb"/Type /Page\b", knees)) == 7
    box = [float(x) for x in re.search(rb"/MediaBox \[([^\]]*)\]", knees)[1].split()]
    np.testing.assert_allclose(box, [0.0, 0.0, 419.5, 595.3], atol=0.6)  # A5 in points
    assert not list(folder.rglob("*.lua"))  # a pilot flies
    assert not list(folder.rglob("*.part"))


def test_the_page_answers_and_links_to_what_is_there(written):
    _, folder = written
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "63 runs (37 longitudinal, 26 lateral) at 2 points take" in page
    linked = re.findall(r"<li><a href=\"cards/.*?</li>", page, flags=re.S)
    assert [" – scaled to 80 %, watch</li>" in line for line in linked] == [k in (4, 7) for k in range(1, 8)]
    links = re.findall(r'href="([^"#]+)"', page)
    assert len(links) >= 7 * 3
    for link in links:
        assert (folder / link).is_file(), link


@pytest.mark.usefixtures("rendered")
@pytest.mark.slow
def test_the_same_plan_gives_the_same_bytes(taurus_plan, tmp_path):
    taurus_plan = replace(taurus_plan, cards=taurus_plan.cards[:1])
    one = {p.name: p.read_bytes() for p in write_cards(taurus_plan, tmp_path / "a")}
    two = {p.name: p.read_bytes() for p in write_cards(taurus_plan, tmp_path / "b")}
    assert one == two


@pytest.mark.slow
def test_a_card_is_the_same_page_each_time(written, taurus_plan):
    card = taurus_plan.cards[0]
    with on_paper():
        page = draw.pdf_pages([draw.styled(card_page(card, taurus_plan))])
    assert page == (written[1] / "cards" / f"{card_stem(card)}.pdf").read_bytes()


def test_the_sequence_is_said_with_times_and_amplitudes(eolo_plan, taurus_plan):
    (line,) = sequence_lines(eolo_plan.cards[0])
    amplitude = 4.0 * eolo_plan.cards[0].factor
    assert f"elevator (+: trailing edge down): 1.00 to 1.90 s: +{amplitude:.2f}\u00a0deg; 1.90 to 2.50 s: −" in line
    assert line.endswith("2.80 to 3.10 s: −" + f"{amplitude:.2f}\u00a0deg; then trim")
    (line,) = sequence_lines(eolo_plan.cards[1])
    assert "multisine from 1 s, 4 to 20 Hz, 3 periods of 4 s; peak 3.00\u00a0deg" in line
    (line,) = sequence_lines(taurus_plan.cards[1])
    assert line.startswith("throttle (+: more power)")


def test_levels_of_a_held_signal():
    t = np.arange(0.0, 2.0, 0.01)
    u = np.where((t >= 0.5) & (t < 0.9), 2.0, 0.0) - np.where((t >= 0.9) & (t < 0.95), 2.0, 0.0)
    assert levels(t, u) == [(0.5, pytest.approx(0.9), 2.0)]  # the last one is too short to be said


def test_a_card_says_what_decides_the_next_step(eolo_plan):
    card, last = eolo_plan.cards[0], eolo_plan.cards[-1]
    text = card_text(card, eolo_plan)
    assert text.status.startswith("WATCH V")
    assert "; amplitude scaled to" in text.status
    assert text.go.startswith("GO to 19 m/s if testbench modes clears it")
    torsion = next(row for row in text.modes if row[0] == "1st sym. wing torsion + boom bending")
    assert torsion[2:] == ("0.0270", "0.0167")
    assert dict(text.setup)["player"] == f"your own, at 200 Hz, from {card_stem(card)}.csv"
    assert any("11 % below 20.3 m/s" in value for _, value in text.setup)
    assert ("vibration", "dies away") in [row[:2] for row in text.limits]
    assert all(row[3].startswith("PILOT watches") for row in text.limits)
    assert card_text(last, eolo_plan).go.startswith("last speed")
    assert "V" in beyond_limits(card)
    assert text.standing.endswith("%, watch")
    assert text.before[0].startswith("limits: GO if the monitor of")


def test_a_card_is_to_fly_only_where_its_band_keeps_every_limit(taurus_plan, eolo_plan):
    for card in (*taurus_plan.cards, *eolo_plan.cards):
        inside = card.status == "fly" and not beyond_limits(card)
        assert (standing(card) == "fly") == inside, card.title
    assert [row[5] for row in short_cards(eolo_plan).rows] == [standing(c) for c in eolo_plan.cards]
    assert {standing(c) for c in eolo_plan.cards} >= {"fly"}
    assert any("watch" in standing(c) for c in eolo_plan.cards)


def test_tables_of_an_autopilot_s_plan(eolo_plan, tmp_path):
    eolo_plan = replace(eolo_plan, cards=eolo_plan.cards[:2])
    paths = plan_page(eolo_plan).write(tmp_path)
    assert not [p for p in paths if p.suffix in (".lua", ".py")]  # faster than scripting: a player of one's own
    assert paths[-1].name == "report.html"
    assert any("the fastest point, 19 m/s, lies 6 % below it" in text for _, text in plan_answer(eolo_plan))
    table = points_table(eolo_plan)
    assert [row[-1] for row in table.rows] == ["go", "go"]
    assert len(modes_table(eolo_plan).rows) == sum(len(p.modes) for p in eolo_plan.points)
    assert len(runs_table(eolo_plan).rows) == len(eolo_plan.runs)


@pytest.mark.parametrize(("system", "suffix", "shown"), [("ardupilot", ".lua", "Lua"), ("px4", ".py", "Python")])
def test_each_autopilot_gets_its_scripts(eolo_plan, tmp_path, system, suffix, shown):
    cards = (eolo_plan.cards[0], eolo_plan.cards[2])  # the 3-2-1-1 of both speeds
    autopilot = Autopilot(system=system)
    plan = replace(eolo_plan, cards=cards, scenario=eolo_plan.scenario.model_copy(update={"autopilot": autopilot}))
    paths = plan_page(plan).write(tmp_path)
    assert [p.stem for p in paths if p.suffix == suffix] == [card_stem(c) for c in cards]
    page = paths[-1].read_text(encoding="utf-8")
    for link in re.findall(r'href="([^"#]+)"', page):
        assert (tmp_path / link).is_file(), link
    assert f">{shown}</a>" in page
    text = card_text(cards[0], plan)
    assert dict(text.setup)["script"].startswith(f"{card_stem(cards[0])}{suffix}")
    who = {row[0]: row[3] for row in text.limits}
    assert who["V"] == "script watches, as the plan says; highest: onset of the instability"  # 20.3 and not 22 m/s
    for quantity in ("load factor", "h", "θ", "φ", "α"):
        assert who[quantity] == "script watches, as the plan says"
    assert who["β"] == "PILOT watches, limits of eolo"  # nothing measures it


def test_nothing_overlaps_on_the_page_of_a_card(eolo_plan, taurus_plan):
    for plan in (eolo_plan, taurus_plan):
        for card in plan.cards:
            sheet, *panels = card_page(card, plan).panels  # places are inches from the upper edge
            written = {d.text: d.y for d in sheet.draws if isinstance(d, Words)}
            boxes = [p.box_in for p in panels]
            assert max(y + tall for _, y, _, tall in boxes) < written["Damping"] - 0.3  # room for the ticks
            assert min(y for _, y, _, _ in boxes) > written["Control sequence"] + 0.2
            assert max(written.values()) < sheet.box_in[3]
            assert max(x + wide for x, _, wide, _ in boxes) < sheet.box_in[2]
            (knee,) = kneeboard_page(card, plan).panels
            assert max(d.y for d in knee.draws if isinstance(d, Words)) < knee.box_in[3] - 0.2


def test_panels_show_all_that_is_expected_and_where_damping_ends(eolo_plan):
    for card in eolo_plan.cards:
        for panel in card_page(card, eolo_plan).panels[1:]:
            low, high = panel.y_range
            curves = [d.y for d in panel.draws if isinstance(d, Curve)]
            curves += [y for d in panel.draws if isinstance(d, Area) for _, y in d.outlines]
            y = np.concatenate([*curves, [d.at for d in panel.draws if isinstance(d, Rule) and d.of == "y"]])
            room = 0.02 * (high - low)
            assert low + room < y.min() < y.max() < high - room, panel.title
            assert np.ptp(y) > 0.4 * (high - low), panel.title  # of one side if a command has one
    (plate,) = [p for p in plan_page(eolo_plan).plates if p.name == "build_up"]
    damping = next(p for p in plate.chart.panels if "damped" in p.title)
    low, high = damping.y_range
    points = np.concatenate([d.y for d in damping.draws if isinstance(d, Curve) and d.marker])
    assert low < min(0.0, points.min()) <= points.max() < high


def test_cards_speak_in_the_units_of_who_flies(taurus_plan):
    """Knots, feet and litres: 12 m/s are 23 kt, 100 m 330 ft; a run's 1.43 Wh at 43 MJ/kg and 0.72 kg/l 0.17 ml."""
    fuel = Fuel(kind="fuel", capacity_kg=0.2, efficiency_percent=45.0, source="s")
    said = OnTheCard(units="aviation", configuration="gear up", hazards=("birds",), emergency=("loss of link: circle",))
    scenario = taurus_plan.scenario.model_copy(update={"card": said, "energy": fuel})
    plan = replace(taurus_plan, scenario=scenario)
    card = plan.cards[0]
    text = card_text(card, plan)
    setup = dict(text.setup)
    assert setup["speed"].replace("\u00a0", " ") == "23 kt true, 23.2 kt equivalent"
    assert setup["height"].startswith("330\u00a0ft above sea level")
    assert setup["configured"] == "gear up"
    assert setup["mass, c.g."].startswith("1.8 kg; c.g. 16 % of the chord ahead of")
    assert setup["build-up"] == "speed 1 of 2: 23.3, 27.2 kt, slow to fast"
    assert next(span for name, span, _, _ in text.limits if name == "V") == "15.6 to 31.1 kt"
    litres = float(re.search(r"fuel: GO if ([\d.e-]+) litres", text.before[-1])[1])
    assert litres == pytest.approx(1.43 * 3600.0 / (43e6 * 0.72), rel=0.05)
    assert text.hazards[0] == "birds"
    assert text.emergency == said.emergency
    assert text.calls[0].startswith("KNOCK IT OFF: release")
    shown = [w.text for row in kneeboard_page(card, plan).rows for p in row for w in p.draws if isinstance(w, Words)]
    assert {"gear up", "loss of link: circle", "birds"} <= {t.strip() for t in shown}
    metric = dict(card_text(card, taurus_plan).setup)
    assert metric["speed"] == "12 m/s true, 11.9 m/s equivalent"


def test_a_speed_waits_until_flights_of_slower_ones_clear_it(tmp_path):
    """The first two speeds are flown; then what testbench modes found says how far, at which risk, on every card."""
    base = PlanScenario.load(SCENARIOS / "plan" / "eolo_envelope.toml")
    asked = base.model_copy(update={"speeds_m_s": (13.0, 14.0, 16.0, 18.0), "manoeuvre": (base.manoeuvre[1],)})
    plan = make_plan(asked, fly_envelope)
    assert [row[-1] for row in points_table(plan).rows] == ["go", "go", "not cleared yet", "not cleared yet"]
    assert any(text.startswith("NO-GO yet at 16 and 18 m/s: testbench modes") for _, text in plan_answer(plan))
    assert card_text(plan.cards[2], plan).before[0].startswith("speed: NO-GO yet")
    file = tmp_path / "models" / "clearance.json"
    file.parent.mkdir()
    told = {"flown_m_s": [13.0, 14.0], "cleared_m_s": 16.1, "risk": 0.01, "onset_m_s": {"0.5": 20.4}}
    file.write_text(json.dumps(told), "utf-8")
    cleared = replace(plan, cleared=read_cleared(tmp_path))
    assert [row[-1] for row in points_table(cleared).rows] == ["go", "go", "go", "not cleared yet"]
    said = card_text(cleared.cards[2], cleared).before[0]
    assert said.startswith("speed: GO, cleared to 16.1 m/s; flutter lies lower at a probability of 1 %")
    file.write_text(json.dumps(told | {"risk": 7.0}), "utf-8")
    with pytest.raises(RecordError, match="risk"):
        read_cleared(tmp_path)
    with pytest.raises(RecordError, match="--after takes the folder of a result of testbench modes"):
        read_cleared(file)


def test_accuracy_out_of_reach_is_said_with_the_best_and_what_stands_in_the_way():
    base = PlanScenario.load(SCENARIOS / "plan" / "eolo_envelope.toml")
    keen = base.manoeuvre[0].model_copy(update={"accuracy_percent": {"M_alpha": 0.5, "M_de": 5.0}, "most_repeats": 4})
    plan = make_plan(base.model_copy(update={"speeds_m_s": (16.0, 18.0), "manoeuvre": (keen,)}), fly_envelope)
    assert [c.repeats for c in plan.cards] == [4, 4]
    doubts = [text for kind, text in plan_answer(plan) if kind == "doubt" and "M_alpha" in text]
    best = plan.cards[0].reached[0]
    assert doubts[0].startswith(f"card 1, M_alpha: {100.0 * best.reached:.2g} % reached, 0.5 % wanted; that takes")
    assert best.needed == int(np.ceil((best.one / 0.005) ** 2))
    assert "noise of the sensors" in doubts[0]
    assert "limit on its amplitude (V passes" in doubts[1]  # scaled at 18 m/s
    assert not any("M_de" in text for text in doubts)


def test_a_plan_with_every_card_refused_is_written_and_says_so(tmp_path):
    base = PlanScenario.load(SCENARIOS / "plan" / "taurus_63.toml")
    tight = base.model_copy(
        update={"limits": base.limits.model_copy(update={"alpha_deg": (-5.0, 3.0)}), "speeds_m_s": (12.0,),
                "manoeuvre": base.manoeuvre[:1]}
    )  # fmt: skip
    plan = make_plan(tight, fly_envelope)
    assert next(plan_answer(plan)) == ("lead", "nothing can be flown: every card is refused")
    plan_page(plan).write(tmp_path)
    assert "REFUSED, do not fly" in next((tmp_path / "cards").glob("*.html")).read_text(encoding="utf-8")


def test_faults_reach_the_user_as_one_message(tmp_path):
    text = (SCENARIOS / "plan" / "eolo_envelope.toml").read_text(encoding="utf-8")
    file = tmp_path / "fast.toml"
    file.write_text(text.replace("18.0, 19.0]", "18.0, 19.5, 22.0]"), encoding="utf-8")
    done = command("plan", file, "-o", tmp_path / "out")
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert done.stderr.count("allow_above_onset") == 2
    assert not (tmp_path / "out").exists()
    file.write_text(text.replace('flown_by = "autopilot"', 'flown_by = "autopilott"'), encoding="utf-8")
    done = command("check", file)
    assert done.returncode == 2
    assert "did you mean 'autopilot'" in done.stderr


def test_check_list_and_the_wrong_command(tmp_path):
    done = command("check", *sorted((SCENARIOS / "plan").glob("*.toml")))
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("a valid flight plan") == 2
    assert "plan/taurus_63" in command("list", "scenarios").stdout
    done = command("run", "plan/taurus_63", "-o", tmp_path)
    assert done.returncode == 2
    assert "is a flight plan: use testbench plan" in done.stderr
    done = command("plan", "taurus_36", "-o", tmp_path)
    assert "did you mean 'taurus_63'?" in done.stderr
