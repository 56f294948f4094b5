"""What is written: every file whole, the page self-contained and safe, the same bytes each time."""

import base64
import hashlib
import html
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from io import StringIO
from pathlib import Path
from urllib.parse import unquote
from xml.etree import ElementTree

import pytest
from jinja2 import UndefinedError
from rich.console import Console

from testbench.core.record import load_record
from testbench.core.store import OWN, ResultFolder
from testbench.page.html import first_screen, render, svg_uri
from testbench.page.page import record_keeper, source_of
from testbench.page.shown import write_results
from testbench.questions.run.page import run_page

pytestmark = pytest.mark.drawn

VOID = {"meta", "img", "source", "br", "link"}


class Reader(HTMLParser):
    """Checks that tags nest, and collects every address that the page refers to."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.addresses: list[str] = []
        self.tags: set[str] = set()
        self.ids: list[str] = []

    def handle_starttag(self, tag: str, attrs) -> None:
        self.tags.add(tag)
        found = dict(attrs)
        self.addresses += [found[k] for k in ("src", "srcset", "href") if k in found]
        self.ids += [found["id"]] if "id" in found else []
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def written(result, tmp_path_factory) -> tuple[Path, list[Path]]:
    folder = tmp_path_factory.mktemp("written")
    return folder, write_results(result, folder)


@pytest.fixture(scope="module")
def page(written) -> str:
    return (written[0] / "report.html").read_text(encoding="utf-8")


def test_all_files_are_written_and_no_part_is_left(written) -> None:
    folder, paths = written
    assert all(path.is_file() for path in paths)
    assert sorted(paths) == sorted(p for p in folder.rglob("*") if p.is_file() and OWN not in p.parts)
    names = {p.relative_to(folder).as_posix() for p in paths}
    assert {"report.html", "tables/mrse.csv", "tables/mrse.json", "models/eolo_alpha_dsr_e.json"} <= names
    assert {"figures/input_de.png", "figures/time_histories.png", "figures/bode_de.png", "figures/poles.png"} <= names
    assert paths[-1].name == "report.html"


def test_the_same_result_writes_the_same_bytes(written, make_result, tmp_path) -> None:
    for path in write_results(make_result(), tmp_path):
        assert path.read_bytes() == (written[0] / path.relative_to(tmp_path)).read_bytes(), path.name


def test_the_page_is_well_formed_and_fetches_nothing(page: str) -> None:
    reader = Reader()
    reader.feed(page)
    reader.close()
    assert reader.open == []
    scripts = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    assert len(scripts) == page.lower().count("<script") == 1
    digest = base64.b64encode(hashlib.sha256(scripts[0].encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in page
    assert "innerHTML" not in scripts[0]
    assert reader.addresses
    assert all(a.startswith(("#", "data:image/svg+xml,")) for a in reader.addresses)
    assert {a[1:] for a in reader.addresses if a.startswith("#")} <= set(reader.ids)
    assert not re.search(r"url\((?!%23)|@import", page)  # a drawing clips by parts of its own


def test_every_figure_is_on_the_page_wide_and_those_not_explored_narrow(page: str) -> None:
    images = re.findall(r'(?:srcset|src)="data:image/svg\+xml,([^"]+)"', page)
    explored = re.findall(r'data-explore="([^"]+)"', page)
    assert len(explored) == 4
    assert len(images) == 2 * 6 - len(explored)
    assert all(ElementTree.fromstring(unquote(image)).tag.endswith("svg") for image in images)


def test_a_drawing_on_the_page_is_the_drawing_in_letters_that_need_no_base64() -> None:
    """Of an eighth more the page of all methods was too large: 1.50 MB."""
    text, path = """5 % + #3, "a" 'b' &lt; ü""", '<path d="m1 2l3 4" style="fill:#f00"/>'
    svg = f'<svg xmlns="a"><text>{text}</text>{path}</svg>'
    uri = svg_uri(svg)
    assert not re.search(r"""[\s"<>&#]""", uri)  # safe in an attribute, in srcset, and before a fragment
    back = ElementTree.fromstring(unquote(uri.removeprefix("data:image/svg+xml,")))
    as_it_was = ElementTree.fromstring(svg)
    assert [(e.tag, e.text) for e in back.iter()] == [(e.tag, e.text) for e in as_it_was.iter()]
    assert back[1].attrib == {"d": "m1,2l3,4", "style": "fill:#f00"}
    long = '<svg d="' + "1.25 -3.5" * 1000 + '"/>'
    assert len(svg_uri(long)) < 0.8 * len(base64.b64encode(long.encode()))


def test_text_is_escaped_and_the_scenario_stands_verbatim(page: str, result) -> None:
    assert "<h1>Small &lt;world&gt; &amp; co</h1>" in page
    assert "Is q &lt; 1?" in page
    shown = re.search(r"<pre>(.*?)</pre>", page, re.DOTALL)
    assert shown
    assert html.unescape(shown[1]) == source_of(result.source)[1]
    assert "a comment that must survive" in shown[1]


def test_the_page_says_where_its_figures_come_from(page: str, result) -> None:
    for text in ("flight-testbench", "numpy", "scipy", "<dt>seed</dt><dd>3</dd>", "jsbsim 1.0", "small.toml, verbatim"):
        assert text in page
    for text in (
        "Aircraft and trim",
        "Sensors",
        "potentiometer on an air data boom",
        "doublet on δe, 2 deg, period 2\u00a0s",
    ):
        assert text in page
    assert html.escape(result.suites[0].sensors[0].source, quote=False)[:40] in page.replace("&#39;", "'")
    assert str(result.source.file.parent) not in page


def test_the_answer_stands_before_everything_else(page: str) -> None:
    names = ("answer", "figure-answer", "flown", "figures", "tables", "models", "provenance")
    order = [page.index(f'id="{name}"') for name in names]
    assert order == sorted(order)
    assert 'class="doubt">Doubt: eolo_alpha, dsr_e: doubt this.' in page


def test_an_answer_is_split_between_what_stands_above_and_below_its_figure() -> None:
    short = ["it holds", "q: does not", ("note", "by the way"), ("doubt", "b_1 is doubtful!")]
    assert first_screen(short) == (
        [("lead", "It holds."), ("finding", "q: does not."), ("doubt", "b_1 is doubtful!")],
        [],
    )
    told = ["it holds", "b", "c", "d", ("wrong", "do not use: e")]
    shown, folded = first_screen(told)
    assert shown == [("lead", "It holds."), ("finding", "B."), ("wrong", "Do not use: e.")]
    assert folded == [("finding", "C."), ("finding", "D.")]
    clauses = "; ".join(f"clause {k} of it" for k in range(9))
    assert first_screen([clauses, "more"]) == (
        [
            ("lead", "Clause 0 of it; clause 1 of it; clause 2 of it; clause 3 of it; clause 4 of it; clause 5 of it."),
            ("finding", "More."),
        ],
        [("finding", "Clause 6 of it; clause 7 of it; clause 8 of it.")],
    )
    assert first_screen(["word " * 400])[0] == [("lead", "Word " + "word " * 399 + ".")]
    assert first_screen([]) == ([], [])


def test_models_are_written_with_all_their_values(written, result) -> None:
    model = json.loads((written[0] / "models" / "eolo_alpha_dsr_e.json").read_text(encoding="utf-8"))
    assert model.pop("condition") == {"V_m_s": 16.0}, "what designs after this flight must know"
    assert model == result.cases[1].model.to_dict()


def test_two_cases_of_one_name_do_not_overwrite_each_other(make_result, tmp_path) -> None:
    base = make_result(truth=None)
    paths = write_results(make_result(truth=None, cases=base.cases[:1] * 2), tmp_path)
    assert len([p for p in paths if p.parent.name == "models"]) == 2
    assert len(set(paths)) == len(paths)


def test_records_are_kept_under_safe_names(result, tmp_path) -> None:
    record = result.flights[0].truth
    with ResultFolder(tmp_path) as place:
        record_keeper(place)("slow / truth", record)
    kept = load_record(tmp_path / "records" / "slow_truth.nc")
    assert kept.channels == record.channels
    assert (kept.data == record.data).all()


def test_a_template_that_lacks_a_value_is_refused() -> None:
    with pytest.raises(UndefinedError):
        render("questions/run/page.html.j2", title="only this")


@pytest.mark.parametrize("width", [60, 120])
def test_the_terminal_shows_answer_table_and_place(result, width: int) -> None:
    out = StringIO()
    run_page(result).show(Console(file=out, width=width, color_system=None), Path("results/small"))
    text = out.getvalue()
    assert "Small <world> & co" in text
    assert "doubt this." in text
    assert re.search(r"eolo_no_alpha +– +25.0 +25.0 +25.0", text)
    assert "Report: results/small/report.html" in text


def test_the_terminal_names_no_place_where_nothing_was_written(result) -> None:
    out = StringIO()
    run_page(result).show(Console(file=out, width=80, color_system=None))
    assert "report.html" not in out.getvalue()


def test_what_a_record_says_of_itself_is_words_without_its_mappings(result) -> None:
    (first, *rest) = result.flights
    said = {
        "log": {"sys_name": "PX4", "channels": {"q": {"source": "a.b", "assumed": ""}}, "lost": []},
        "segment_s": [0, 9],
    }
    flown = replace(first, truth=replace(first.truth, provenance=said))
    (told, *_) = [
        v for k, v in run_page(replace(result, flights=(flown, *rest))).provenance if k == f"record {first.name}"
    ]
    assert told == "log (sys_name PX4), segment_s [0, 9]"
