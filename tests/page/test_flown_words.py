"""What flew: one sentence and one table for all questions, from counts or from the records themselves."""

import io

import numpy as np
from rich.console import Console

from testbench.core.record import FlightRecord
from testbench.flight.batch.jobs import BATCH, JSBSIM, Tally
from testbench.page.flown import flown_table, flown_words
from testbench.page.page import Page


def record(simulator: str) -> FlightRecord:
    return FlightRecord(np.arange(2.0), ("V",), np.zeros((2, 1)), "truth", provenance={"simulator": simulator})


def test_records_say_what_flew_them_and_why():
    reason = "it has the function <random>"
    tally = Tally.of([record(BATCH), record(BATCH), record(f"{JSBSIM}{reason}"), record(f"{JSBSIM}it is wanted")])
    assert (tally.batch, tally.jsbsim, tally.reasons) == (2, 2, {reason: 1, "it is wanted": 1})
    assert flown_words(tally) == (
        "2 flights flown in batches, by a translation of the model that agrees with JSBSim (one flight in 200 is "
        "flown by both); 1 flight flown by JSBSim one by one, as it has the function <random>; 1 flight flown by "
        "JSBSim one by one, as it is wanted"
    )
    assert flown_words(Tally()) == ""


def test_flights_flown_by_both_say_how_far_they_are_apart():
    words = flown_words(Tally(batch=400, both=2, worst=3.2e-11), "run")
    assert "400 runs flown in batches" in words
    assert "here 2, which differ by at most" in words
    assert "of the range of a channel" in words


def test_the_table_has_a_row_for_each_reason():
    tally = Tally(batch=9)
    tally.by_jsbsim("b", 2)
    tally.by_jsbsim("a")
    table = flown_table(tally, "run")
    assert [row[:2] for row in table.rows] == [("batch", 9), ("JSBSim", 1), ("JSBSim", 2)]
    assert [row[2] for row in table.rows[1:]] == ["a", "b"]


def test_a_page_says_it_on_paper_on_the_terminal_and_in_files(tmp_path):
    page = Page(kicker="k", title="t", answer=["one"], flown=Tally(batch=8))
    names = {str(p.relative_to(tmp_path)) for p in page.write(tmp_path)}
    assert {"tables/flown.csv", "tables/flown.json"} <= names
    words = "8 flights flown in batches"
    assert words in (tmp_path / "report.html").read_text(encoding="utf-8")
    console = Console(file=io.StringIO(), width=200)
    page.show(console)
    assert words in console.file.getvalue()
    plain = Page(kicker="k", title="t", answer=["one"])
    plain.write(tmp_path / "plain")
    assert not (tmp_path / "plain" / "tables" / "flown.csv").exists()
