"""Figures for a paper: formats, width, style, refusals, and data that draws them again."""

import csv
import runpy
from pathlib import Path

import numpy as np
import pytest
import typer
from matplotlib import rc_context
from typer.testing import CliRunner

from testbench.core.errors import MissingPackage, RecordError
from testbench.page.draw import styled
from testbench.page.figure import Chart, Curve, Image, Panel, Plate, bars, line_look
from testbench.page.publish import Publication, asked, latex_text, publish, published, set_by_latex
from testbench.questions.options import with_figures

pytestmark = pytest.mark.drawn

T_S = np.linspace(0.0, 2.0, 7)


UPPER = Panel(
    draws=[Curve(x=T_S, y=1.0 / 3.0 + T_S, name="first, 50 %", **line_look(0)),
           Curve(x=T_S[:4], y=-T_S[:4], name="second", **line_look(1))],
    title="upper", x="t, s", y="Δα, deg", tall_in=0.7,
)  # fmt: skip
LOWER = Panel(
    draws=[bars([1.0], 1.0, [6.0], 0.5), Curve(x=[1.0], y=[1.0], marker="s", colour="#0072B2")],
    title="lower", x="t, s", y="rate, deg/s", log_x=True, tall_in=0.7,
)  # fmt: skip
CHART = Chart([[UPPER], [LOWER]])
PLATE = Plate("some_lines", "A title", "a caption", CHART)


def test_a_figure_comes_in_each_format_of_the_column_with_data_that_draw_it_again(tmp_path: Path, monkeypatch) -> None:
    paths = publish(PLATE, tmp_path, Publication(("pdf", "svg", "png"), double=False))
    assert {path.suffix for path in paths} == {".pdf", ".svg", ".png", ".csv", ".py"}
    assert b"/MediaBox [ 0 0 252 " in (tmp_path / "some_lines.pdf").read_bytes()  # 3.5 in, 72 points each
    assert 'width="252pt"' in (tmp_path / "some_lines.svg").read_text(encoding="utf-8")
    heads, *rows = csv.reader((tmp_path / "some_lines.csv").open(encoding="utf-8"))
    assert heads == [
        "1.1 t, s", "1.1 Δα, deg | upper | first, 50 %", "1.2 t, s", "1.2 Δα, deg | upper | second",
        "2.1 t, s", "2.1 rate, deg/s | lower", "2.2 t, s", "2.2 rate, deg/s | lower",
    ]  # fmt: skip
    first = np.array([[float(v) for v in row[:2]] for row in rows if row[0]])
    np.testing.assert_allclose(first, np.column_stack([T_S, 1.0 / 3.0 + T_S]), rtol=1e-9)
    bar = np.array([[float(v) for v in row[4:6]] for row in rows if row[4]])
    assert (bar.min(axis=0).tolist(), bar.max(axis=0).tolist()) == ([1.0, 0.75], [6.0, 1.25])
    monkeypatch.setenv("MPLBACKEND", "Agg")
    with rc_context():
        drawn = runpy.run_path(str(tmp_path / "some_lines.py"))["panels"]
    np.testing.assert_allclose(drawn[0].lines[0].get_xydata(), first, rtol=1e-12)
    assert (drawn[1].get_xscale(), drawn[1].get_xlabel(), len(drawn[1].patches)) == ("log", "t, s", 1)
    assert (tmp_path / "some_lines_redrawn.png").stat().st_size > 5_000


def test_images_and_panels_without_axes_are_drawn_again_as_they_are(tmp_path: Path, monkeypatch) -> None:
    energy = Image(values=np.array([[1.0, 10.0, np.nan]]), low=1.0, high=100.0, log=True)
    sketch = Panel(draws=[bars([0.0], 0.0, [1.0], 0.5)], bare=True, x_range=(0.0, 2.0), y_range=(-1.0, 1.0))
    publish(Plate("map", "t", "c", Chart([[Panel(draws=[energy])], [sketch]])), tmp_path, Publication(("svg",)))
    monkeypatch.setenv("MPLBACKEND", "Agg")
    with rc_context():
        first, second = runpy.run_path(str(tmp_path / "map.py"))["panels"]
    np.testing.assert_array_equal(np.ma.filled(first.images[0].get_array(), np.nan), energy.values)
    assert type(first.images[0].norm).__name__ == "LogNorm"
    assert (second.get_frame_on(), second.get_xlim(), list(second.get_xticks())) == (False, (0.0, 2.0), [])


def test_a_style_is_laid_over_the_houses(tmp_path: Path) -> None:
    style = tmp_path / "mine.mplstyle"
    style.write_text("figure.figsize: 5, 1\naxes.prop_cycle: cycler('color', ['ff0000', '00ff00'])\n")
    publish(PLATE, tmp_path, Publication(("svg",), style=style))
    text = (tmp_path / "some_lines.svg").read_text(encoding="utf-8")
    assert 'width="360pt"' in text
    assert "#ff0000" in text
    assert "#0072b2" not in text.lower()
    assert "first, 50 %" in (tmp_path / "some_lines.csv").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("line", "said"),
    [(None, "which is no file"), ("fnt.size: 8", "Bad key fnt.size"), ("font.size: eight", "eight"), ("", "has none"),
     ("figure.figsize: 1, 1", "got 1 in")],
)  # fmt: skip
def test_a_bad_style_is_refused_before_anything_is_done(tmp_path: Path, line: str | None, said: str) -> None:
    style = tmp_path / "bad.mplstyle"
    if line is not None:
        style.write_text(line + "\n")
    with pytest.raises(RecordError, match=said), published(Publication(("pdf",), style=style)):
        raise AssertionError("the block must not be entered")


def test_latex_is_refused_where_there_is_none_and_texts_are_no_commands(monkeypatch) -> None:
    monkeypatch.setattr("shutil.which", lambda name: None)
    with (
        pytest.raises(MissingPackage, match="no latex and no kpsewhich; install"),
        published(Publication(("pdf",), latex=True)),
    ):
        raise AssertionError("the block must not be entered")
    assert latex_text(r"a_b & 5 % \x{$}") == r"a\_b \& 5 \% \textbackslash{}x\{\$\}"
    assert latex_text("10⁻², η₁ 3°") == r"10$^{-2}$, $\eta$$_{1}$ 3\textdegree{}"
    figure = styled(CHART)
    with rc_context({"text.parse_math": False}):
        set_by_latex(figure)
    assert figure.axes[0].get_ylabel() == r"$\Delta$$\alpha$, deg"
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [r"first, 50 \%", "second"]
    assert figure.axes[1].xaxis.get_major_formatter().format_ticks([0.1, 10.0]) == ["0.1", "10"]


def test_the_options_stand_around_a_command() -> None:
    app, seen = typer.Typer(), []

    @app.command()
    @with_figures
    def ask(name: str) -> None:
        seen.append((name, asked()))

    run = CliRunner().invoke
    assert run(app, ["x", "--figures", "PDF,svg", "--column", "single"]).exit_code == 0
    assert run(app, ["y"]).exit_code == 0
    assert seen == [("x", Publication(("pdf", "svg"), double=False)), ("y", None)]
    for refused, said in ((["--figures", "jpg"], "got 'jpg'"), (["--latex"], "--latex has no use without")):
        done = run(app, ["x", *refused])
        assert done.exit_code == 2
        assert said in " ".join(done.output.replace("│", " ").split())
    assert len(seen) == 2
