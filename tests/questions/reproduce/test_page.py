"""The page and its files: every printed number with its place, nothing fetched from elsewhere, clear refusals."""

import csv
import io
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from html import unescape
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from testbench.core.errors import ScenarioError, WriteError
from testbench.core.store import LOCK, ResultFolder
from testbench.page.figure import Panel, Rule
from testbench.questions.reproduce import bench, paper_checks
from testbench.questions.reproduce.ask import CHAPTERS, reproduce
from testbench.questions.reproduce.bench import polynomial
from testbench.questions.reproduce.page import PAGE, groups, summary, write_reproduction
from testbench.questions.reproduce.section import (
    VERDICTS,
    Chapter,
    Section,
    Why,
    Written,
    claim_row,
    judge_claim,
    line,
    number_row,
    plate,
)

pytestmark = pytest.mark.drawn

ROOT = Path(__file__).resolve().parents[3]
COMMITTED = ROOT / "results" / "reproduction"


def silent(text: str) -> None:
    """Take progress and show nothing."""


class Printed(NamedTuple):
    """One printed number: the paper, the place, and the text that the page must hold."""

    paper: str
    where: str
    text: str


def printed_numbers() -> Iterator[Printed]:
    """Yield every number of results that the papers print, as the page writes it."""
    for where, above, below in bench.TRANSFER_FUNCTIONS.values():
        yield from (Printed("Taurus", where, bench.shown(v)) for v in (*above, *below[1:]))
    for name, matrix in bench.MATRICES.items():
        yield from (Printed("EOLO", f"section 3.2, {name}", f"{v:.4f}".replace("-", "−")) for v in matrix.ravel())
    for z in (bench.STATED_PAIR.real, bench.STATED_PAIR.imag, bench.STATED_Z3, bench.STATED_Z4):
        yield Printed("EOLO", "section 3.2", f"{z:.4f}".replace("-", "−"))
    for order, rows in bench.TABLE_3.items():
        yield from (Printed("EOLO", f"Table 3, n = {order}", f"{v:.2f}") for row in rows.values() for v in row)
    for which, column in bench.TABLE_4.items():
        yield from (Printed("EOLO", f"Table 4, {which} α", f"{v:.2f}") for v in column.values())
    for value in (*bench.EOLO_TABLE_1.values(), bench.EOLO_ASPECT_RATIO):
        yield Printed("EOLO", "Table 1", bench.shown(value))
    for pair in bench.EOLO_TABLE_2.values():
        yield from (Printed("EOLO", "Table 2", bench.shown(v)) for v in pair)
    shapes = (bench.TAURUS_ASPECT_RATIO, bench.ELEVATOR_DEG, bench.RUDDER_DEG)
    for value in (*bench.TAURUS_TABLE_1_IN.values(), *shapes):
        yield Printed("Taurus", "Table I", bench.shown(value))
    for count in (bench.RUNS, bench.LONGITUDINAL, bench.LATERAL, *bench.SHARE_PERCENT):
        yield Printed("Taurus", "sections V and VII", str(count))
    for count in (bench.IDENTIFICATION, bench.VALIDATION, bench.EOLO_PAST, bench.B1_PAST):
        yield Printed("EOLO", "section 3.2, Tables 3 and 4", str(count))


def chapter(ours: float) -> Chapter:
    """Return a chapter of the papers' own numbers and one result."""
    why = Why("they agree", "they are near", "they part")
    rows = (
        number_row("the number", "Table 9", 10.0, ours, Written("%"), why, headline=True),
        claim_row("the statement", "section 9", "it is so", f"{ours:g}", judge_claim(ours > 5.0), why),
    )
    draws = [line(np.linspace(0.0, 1.0, 50), np.linspace(0.0, ours, 50), "ours", 0), Rule(at=0.95, text="end")]
    drawn = plate("nine_figure", "A figure", "What to see.", [Panel(title="one", x="t, s", y="y", draws=draws)])
    own = Section(
        "nine", "Section nine", (f"We found {ours:g}",), rows, plates=(drawn,), head="It hangs on the horizon"
    )
    return Chapter("paper", "A paper", "Somebody, 2020.", (own, paper_checks.taurus(silent), paper_checks.eolo(silent)))


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("page")
    with ResultFolder(folder) as place:
        write_reproduction([chapter(10.5)], place)
    return folder


def text_of(page: Path) -> str:
    """Return what a reader of the page sees."""
    html = re.sub(r"<style>.*?</style>|base64,[A-Za-z0-9+/=]+", "", page.read_text(encoding="utf-8"), flags=re.S)
    return unescape(re.sub(r"<[^>]+>", " ", html))


def test_the_first_screen_says_what_came_out_and_follows_the_numbers():
    found = {heading: rows for _, heading, rows in groups([chapter(10.5)])}
    assert "the number: 10.00 % printed, 10.5 % here (Table 9)" in dict(found["Comes out"])["A paper"]
    parted = {heading: rows for _, heading, rows in groups([chapter(1.0)])}
    assert "the number" in dict(parted["Does not come out"])["A paper"]
    assert "Comes out" not in parted
    assert "2 agree" in summary([chapter(10.5)])
    assert "2 differ" in summary([chapter(1.0)])


def test_page_tables_and_figures_are_written(written):
    text = text_of(written / PAGE)
    assert text.index("Comes out") < text.index("Section nine")
    assert "We found 10.5." in text
    rows = list(csv.DictReader(io.StringIO((written / "tables" / "paper_printed_and_ours.csv").read_text("utf-8"))))
    assert rows[0]["printed"] == "10.00 %"
    assert rows[0]["verdict"] == "agrees"
    assert {row["verdict"] for row in rows} <= set(VERDICTS)
    assert (written / "tables" / "paper_checks.csv").is_file()
    assert (written / "figures" / "nine_figure.png").read_bytes().startswith(b"\x89PNG")
    assert "10.5 %" in (written / "README.md").read_text("utf-8")


def test_the_same_chapter_gives_the_same_bytes(written, tmp_path):
    with ResultFolder(tmp_path) as place:
        write_reproduction([chapter(10.5)], place)
    for file in sorted(p for p in written.rglob("*") if p.is_file() and p.name != LOCK):
        assert (tmp_path / file.relative_to(written)).read_bytes() == file.read_bytes(), file.name


def test_the_page_fetches_nothing(written):
    for page in (written / PAGE, *COMMITTED.glob("*.html")):
        html = page.read_text(encoding="utf-8")
        assert "default-src 'none'" in html
        assert not re.search(r"""(?:src|href|srcset)=["'](?!data:|#)""", html)
        assert not re.search(r"<script[^>]*\ssrc", html)
        scripts = re.findall(r"script-src ([^;]*);", html)
        assert all(re.fullmatch(r"'sha256-[^']+'", allowed.strip()) for allowed in scripts)


def test_printed_numbers_that_contradict_each_other_are_named():
    checks = {c.what: c.verdict for c in paper_checks.eolo(silent).checks}
    assert checks["z3 as a root of A"] == "differs"
    assert checks["aspect ratio b²/S"] == "agrees"
    words = paper_checks.in_words(paper_checks.eolo(silent).checks)
    assert "z3 as a root of A" in words
    assert "aspect ratio" not in words


def test_the_committed_page_holds_every_printed_number_with_its_place():
    text = text_of(COMMITTED / PAGE)
    missing = [p for p in printed_numbers() if not re.search(rf"(?<![\d.]){re.escape(p.text.lstrip('−'))}(?!\d)", text)]
    assert not missing
    for place in ("equation 6", "equation 9", "Table 3, n = 4", "Table 3, n = 5", "Table 4", "Table 1", "Table 2"):
        assert place in text


def test_the_page_begins_with_the_finding_and_its_figure_and_shows_equations_without_a_script(written):
    html = (written / PAGE).read_text(encoding="utf-8")
    first = html[html.index('class="answer"') : html.index('class="fold"')]
    assert "It hangs on the horizon." in first
    assert first.count("<figure") == 1
    assert html.count("<math ") == 9  # equations 1 to 5 of one paper, 1 to 4 of the other
    text = text_of(written / PAGE)
    for said in ("1.23", "0.55", "elevator chord 4 in", "2 inputs stated", "the largest MRSE of Table 4: q without α"):
        assert said in text


def test_the_committed_folder_is_whole_and_small():
    size = sum(p.stat().st_size for p in COMMITTED.rglob("*") if p.is_file())
    assert 0 < size < 6e6
    text = (COMMITTED / "README.md").read_text("utf-8")
    for name, (title, _, _) in CHAPTERS.items():
        assert f"## {title}" in text
        rows = list(csv.DictReader((COMMITTED / "tables" / f"{name}_printed_and_ours.csv").open(encoding="utf-8")))
        assert rows
        assert {row["verdict"] for row in rows} <= set(VERDICTS)
        assert all(row["where"] and row["why"] for row in rows)
    links = re.findall(r"\]\((figures/[^)]+)\)", text)
    assert links
    assert all((COMMITTED / link).is_file() for link in links)


def test_a_polynomial_reads_as_printed():
    assert polynomial((1.0, 1.079, -3.192, 1.731, 1.772)) == "s⁴ + 1.079 s³ − 3.192 s² + 1.731 s + 1.772"
    assert polynomial((1.091,)) == "1.091"


def test_an_unknown_chapter_is_refused_with_the_nearest_name():
    with pytest.raises(ScenarioError, match=r"taurus, eolo, b1 or all, got 'tauros'.*taurus"):
        reproduce("tauros")


def test_a_folder_that_cannot_be_written_to_is_refused_before_the_work(tmp_path):
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(WriteError, match=r"results must go to a folder.*file.*give another folder"):
        ResultFolder(tmp_path / "file" / "reproduction")


def test_the_command_refuses_an_unknown_chapter_in_one_line(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", "from testbench.cli import main; main()", "reproduce", "eollo", "-o", str(tmp_path)],
        env={**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "200"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode != 0
    assert "eolo" in done.stderr
    assert "Traceback" not in done.stderr + done.stdout
    assert not list(tmp_path.iterdir())
