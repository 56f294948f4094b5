"""The packaged campaign from its file to its report: answer first, tables as figures, page without anything fetched."""

import csv
import io
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from testbench.core.paths import SCENARIOS
from testbench.questions.campaign.answer import campaign_answer, cost_sentence
from testbench.questions.campaign.ask import Progress, fly_campaign
from testbench.questions.campaign.load import load_campaign
from testbench.questions.campaign.page import (
    accuracy_table,
    campaign_page,
    campaign_plates,
    campaign_tables,
    figure_table,
)
from testbench.questions.campaign.progress import show_progress
from testbench.questions.campaign.result import read_campaign
from testbench.questions.campaign.store import Counts, Store
from testbench.questions.campaign.summary import Cause


def answer(result):
    return [*campaign_answer(result)]


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scatter")
    campaign = load_campaign(SCENARIOS / "campaign" / "taurus_scatter.toml")
    fly_campaign(campaign, folder, workers=2)
    with Store.read(folder) as store:
        result = read_campaign(campaign, store)
    return result, folder


def test_the_packaged_campaign_answers_its_question(flown):
    """The four-pole fits are far off in the short period's damping, in every run: the Taurus paper's phenomenon."""
    result, _ = flown
    assert result.counts.finished == 24
    assert result.counts.done >= 20
    said = answer(result)
    assert said[0][0] == "lead"
    fair = sum(not a.biased for a in result.summary.accuracies)
    lead = said[0][1]
    assert lead.startswith(
        f"{fair} of {len(result.summary.accuracies)} estimates show no bias beyond chance; the others"
    )
    assert "% of the true value" in lead
    assert len(lead.split()) <= 25
    for words in ("from run to run they scatter", "states no errors"):
        assert words in said[1][1]
    assert said[2][1].startswith(f"{result.counts.done} of 24 runs are done")
    assert any("bias" in text and "of the true value" in text for kind, text in said if kind == "doubt")
    assert not any("taurus_8hz" in text for kind, text in said if kind == "doubt")  # the one suite needs no name
    found = {a.name: a for a in result.summary.accuracies}
    zeta = found["taurus_8hz, transfer_function: short period (theta) zeta"]
    assert zeta.biased
    assert zeta.bias < -0.3
    wn = found["taurus_8hz, transfer_function: phugoid (theta) wn, rad/s"]
    assert abs(wn.bias / wn.true_mean) < 0.1


@pytest.mark.usefixtures("rendered")
def test_files_and_page(flown):
    result, folder = flown
    paths = campaign_page(result).write(folder)
    assert paths[-1] == folder / "report.html"
    page = paths[-1].read_text(encoding="utf-8")
    assert page.index("The answer") < page.index("no bias beyond chance") < page.index('id="figure-estimates"')
    assert page.count('id="figure-estimates"') == 1
    assert page.index('id="figure-estimates"') < page.index("<main>")
    assert "aircraft.mass_percent" in page
    assert "normal: mean 0.0, std 2.0" in page
    assert not re.search(r"(?:src|href)=[\"']https?:", page)
    assert {p.name for p in (folder / "figures").iterdir()} == {"estimates.png", "distributions.png", "convergence.png"}
    rows = list(csv.reader(io.StringIO((folder / "tables" / "accuracy.csv").read_text(encoding="utf-8"))))
    assert len(rows) == 1 + len(result.summary.accuracies)
    assert json.loads((folder / "tables" / "figures.json").read_text(encoding="utf-8"))["rows"]
    first = {p: p.read_bytes() for p in paths}
    assert {p: p.read_bytes() for p in campaign_page(result).write(folder)} == first


def _of_first(result, n):
    """The summary as after the first ``n`` runs."""
    done = result.summary.done & (np.cumsum(result.summary.done) <= n)
    return replace(result.summary, done=done)


@pytest.mark.parametrize("n", [3, 4, 24])
def test_a_campaign_of_few_runs_draws_how_its_means_settle(flown, n):
    """With four runs the figure was empty, and its axis of runs had ticks at 3.90 and 4.05."""
    plate = {p.name: p for p in campaign_plates(_of_first(flown[0], n))}["convergence"]
    for axes in plate.make(False).axes:
        x = axes.lines[0].get_xdata()
        assert len(x) >= 2
        assert x[-1] <= n
        assert all(float(tick).is_integer() for tick in axes.get_xticks())


def test_two_runs_have_no_figure_of_settling_means(flown):
    assert "convergence" not in {p.name for p in campaign_plates(_of_first(flown[0], 2))}


def test_the_label_of_an_axis_stands_clear_of_its_numbers(flown):
    """At 400 px "mean" lay over "-0.675"."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    for plate in campaign_plates(_of_first(flown[0], 4)):
        figure = plate.make(False)
        FigureCanvasAgg(figure).draw()
        for axes in figure.axes:
            name = axes.yaxis.label.get_window_extent()
            numbers = [t.get_window_extent() for t in axes.get_yticklabels() if t.get_text()]
            assert name.x0 >= 0.0
            assert not any(name.overlaps(box) for box in numbers)


def test_the_only_suite_and_estimator_stand_in_the_caption_not_in_every_row(flown):
    result, _ = flown
    for table in (accuracy_table(result.summary), figure_table(result.summary)):
        assert "Suite taurus_8hz, estimator transfer_function." in table.caption
        shown = [table.columns[0].text(row[0]) for row in table.rows]
        assert "phugoid (theta) zeta" in shown
        assert not any("taurus_8hz" in text for text in shown)
        assert "taurus_8hz, transfer_function: phugoid (theta) zeta" in table.to_csv()
    other = replace(result.summary.figures[0], name="another, transfer_function: phugoid (theta) zeta")
    two = replace(result.summary, figures=(*result.summary.figures, other))
    assert figure_table(two).columns[0].text(other.name) == other.name


def test_the_terminal_and_the_cost(flown):
    result, folder = flown
    console = Console(record=True, width=200, file=io.StringIO())
    campaign_page(result).show(console, folder)
    text = console.export_text()
    assert "runs are done" in text
    assert "report.html" in text
    assert re.search(r"(?i)a run takes \d.* ms of one processor; a million like it would take .* processor hours", text)
    assert "time histories" not in text
    kept = replace(result, records_size=24 * 500_000)
    assert "GB of store and 500 GB of time histories" in cost_sentence(kept)
    assert "the cost is unknown, because no run is finished yet" in cost_sentence(
        type(result)(result.campaign, Counts(3), result.summary, None, 0, 0)
    )


def _changed(result, **accuracy):
    """The result with one estimate alone, changed as given."""
    one = replace(result.summary.accuracies[0], **accuracy)
    return replace(result, summary=replace(result.summary, accuracies=(one,)))


def test_the_lead_tells_bias_scatter_and_coverage_of_one_estimate(flown):
    result, _ = flown
    sharp = {"rms": 0.1, "n": 20, "bias": 0.1, "bias_half": 0.2, "scatter": 0.05, "true_mean": 2.0}
    lead = answer(_changed(result, **sharp, coverage=0.9))[0][1]
    assert "shows no bias beyond chance (0.100 ± 0.20) and scatters by 0.050 from run to run" in lead
    assert "its stated 95 % interval contains the truth in 90.0 % of 20 runs" in lead
    off = answer(_changed(result, **sharp | {"bias_half": 0.01}, coverage=float("nan")))
    assert "has a bias of 0.100 ± 0.010, 5.0 % of the true value" in off[0][1]
    assert "states no errors" in off[0][1]
    assert not any(": bias" in text for _, text in off[1:])
    covered = replace(result.summary.accuracies[0], coverage=0.5, coverage_high=0.7)
    many = replace(result, summary=replace(result.summary, accuracies=(covered, *result.summary.accuracies[1:])))
    assert "(of the 1 estimates that have one) contains the truth in 50 % of the runs" in answer(many)[1][1]


def test_what_is_exact_by_definition_is_no_estimate_without_bias(flown):
    """The damping ratio of a real root is 1 in every run; it was counted as well known."""
    result, _ = flown
    first, *others = result.summary.accuracies
    exact = replace(first, rms=0.0, bias=0.0, bias_half=0.0, scatter=0.0, true_mean=1.0)
    said = answer(replace(result, summary=replace(result.summary, accuracies=(exact, *others))))
    fair = sum(not a.biased for a in others)
    assert said[0][1].startswith(f"{fair} of {len(others)} estimates")
    assert " by 0 to " not in said[1][1]


def test_long_names_stand_in_two_lines_of_a_title(flown):
    """They were cut: "short period, fast root wn,…"."""
    result, _ = flown
    summary = result.summary
    name = summary.accuracies[0].name
    long = [f"taurus_8hz, transfer_function: short period, fast root wn {k}, rad/s" for k in "abc"]
    columns = dict.fromkeys(long, summary.columns[name])
    columns |= {f"{new}, true": columns[new] + 0.1 for new in long}
    accuracies = tuple(replace(summary.accuracies[0], name=new) for new in long)
    for plate in campaign_plates(replace(summary, columns=columns, accuracies=accuracies)):
        titles = [axes.get_title(loc="left").replace("\n", " ") for axes in plate.make(True).axes]
        assert titles == [f"short period, fast root wn {k}, rad/s" for k in "abc"]


@pytest.mark.parametrize("size", [-0.1, 1e-12, 4e9, 0.0])
def test_errors_that_rounding_alone_tells_apart_are_drawn_as_one_bar(flown, size, rendered):
    """No bins fit between them: the page ended in "Too many bins for data range"."""
    summary = flown[0].summary
    name = summary.accuracies[0].name
    true = np.resize([1.0, np.nextafter(1.0, 2.0), 1.0], summary.columns[name].size) * abs(size)
    columns = {**summary.columns, name: true + size, f"{name}, true": true}
    alone = replace(summary, columns=columns, accuracies=summary.accuracies[:1])
    plate = next(p for p in campaign_plates(alone) if p.name == "distributions")
    (axes,) = plate.make(True).axes
    bars = [bar.get_xy() for bar in axes.patches if bar.get_xy()[:, 1].max() == np.count_nonzero(summary.done)]
    assert len(bars) == 1
    assert bars[0][:, 0].min() <= size <= bars[0][:, 0].max()


def test_where_errors_exceed_the_truth_a_bias_is_told_in_units_of_the_scatter(flown):
    """A root at -1e-8 was "off by 4.0e6 %"; percent of nothing say nothing."""
    result, _ = flown
    off = {"n": 20, "bias": 0.4, "bias_half": 0.1, "scatter": 0.2, "rms": 0.45, "true_mean": 1e-8, "coverage": 0.9}
    lead = answer(_changed(result, **off))[0][1]
    assert "0.400 ± 0.10, 2.0 times the scatter (errors exceed the truth, 1.0·10⁻⁸)" in lead
    first = replace(result.summary.accuracies[0], **off)
    many = replace(result, summary=replace(result.summary, accuracies=(first, *result.summary.accuracies[1:])))
    said = " ".join(text for _, text in answer(many))
    near = next(part for part in said.split("; ") if "whose errors exceed the truth" in part)
    assert "2.0" in near
    assert near.endswith("times the scatter")
    assert "10⁷ %" not in said


def test_a_campaign_that_identified_nothing_says_what_failed_and_how_often(flown, tmp_path):
    result, _ = flown
    cause = Cause("LimitError: #", 24, 0, "LimitError: -12.5 <= de <= 12.5 deg must hold, got $99 <b>")
    nothing = replace(
        result,
        counts=Counts(0, 0, 0, 24),
        summary=replace(
            result.summary, columns={}, done=result.summary.done & False, figures=(), accuracies=(), causes=(cause,)
        ),
    )
    said = answer(nothing)
    assert said[0] == (
        "lead",
        f"nothing was identified: all 24 finished runs failed; the most frequent cause of failure, in 24 runs (100 %): "
        f"{cause.example}",
    )
    assert "0 of 24 runs are done, 24 failed" in said[1][1]
    page = campaign_page(nothing).write(tmp_path)[-1].read_text(encoding="utf-8")
    assert 'id="figure-failures"' in page
    assert "$99 &lt;b&gt;" in page
    waiting = replace(nothing, counts=Counts(24), summary=replace(nothing.summary, causes=()))
    assert answer(waiting)[0][1] == "no result yet: none of 24 runs is finished"
    figures = tuple(replace(f, n=0, missing=23) for f in result.summary.figures[:2])
    lost = replace(result, summary=replace(nothing.summary, causes=(), figures=figures))
    assert answer(lost)[0][1].startswith("nothing was identified in the 23 runs that were flown: taurus_8hz")
    unjudged = replace(result, summary=replace(result.summary, accuracies=()))
    assert "the smallest prediction error, taurus_8hz, transfer_function: " in answer(unjudged)[0][1]


def test_a_grid_gives_a_table_of_its_points(flown, tmp_path):
    result, _ = flown
    spec = result.campaign.spec.model_copy(
        update={"grid": {"air.turbulence_rms_m_s": (0.0, 0.1)}, "runs": None, "repeats": 12}
    )
    names = [t.name for t in campaign_tables(result)]
    assert "grid" not in names
    gridded = replace(result, campaign=replace(result.campaign, spec=spec))
    (table,) = [t for t in campaign_tables(gridded) if t.name == "grid"]
    assert len(table.rows) == 2 * len(result.summary.accuracies)
    assert sum(row[2] for row in table.rows[:: len(result.summary.accuracies)]) == result.counts.done


def test_progress_says_rate_failures_and_time_left():
    console = Console(record=True, width=120, file=io.StringIO())
    with show_progress(console) as show:
        show(Progress(Counts(60, 20, 18, 2), 20, 10.0, 2))
        show(Progress(Counts(50, 20, 28, 2), 30, 11.0, 2))
        show(Progress(Counts(0, 0, 98, 2), 100, 50.0, 1))
    lines = console.export_text().splitlines()
    assert lines == [
        "... 20 of 100 runs, 2 failed, 2.0 runs/s on 2 workers, 0:40 left",
        "... 100 of 100 runs, 2 failed, 2.0 runs/s on 1 worker, 0:00 left",
    ]
    terminal = Console(force_terminal=True, width=120, file=io.StringIO())
    with show_progress(terminal) as show:
        show(Progress(Counts(0, 0, 98, 2), 100, 50.0, 1))
    assert "100/100" in terminal.file.getvalue()
