"""A text in Markdown as a page: tables scroll, and nothing of the text becomes code."""

from testbench.page.html import text_page

TABLE = "| a | b |\n| --- | --- |\n| 1 | 2 |\n"
TEXT = f"# A <b>title</b>\n\nSee [here](javascript:alert(1)) <script>alert(1)</script>\n\n{TABLE}\n{TABLE}"


def test_a_text_is_a_page_whose_tables_scroll():
    page = text_page("Data set: mine", TEXT)
    assert "<h1>A &lt;b&gt;title&lt;/b&gt;</h1>" in page
    for k in (1, 2):
        assert page.count(f'<div class="scroll" tabindex="0" role="region" aria-label="table {k}"><table>') == 1
    assert page.count("</table></div></figure>") == 2
    assert "<td>2</td>" in page
    assert "Data set: mine" in page


def test_nothing_of_a_text_becomes_code():
    page = text_page("k", TEXT)
    assert "<script>alert" not in page
    assert 'href="javascript' not in page


def test_indented_lines_are_equations_and_fenced_ones_stay_code():
    text = "# T\n\n    alphadot = -Z_alpha alpha + wn² <= <b>\n\n```python\nzeta = M_alpha\n```\n"
    page = text_page("k", text)
    (shown,) = (part.partition("</pre>")[0] for part in page.split('<pre class="equation">')[1:])
    assert "<i>α\u0307</i> = −<i>Z</i><sub>α</sub> <i>α</i> + <i>ω</i><sub>n</sub>² ≤ &lt;" in shown
    assert "<b>" not in shown
    assert "zeta = M_alpha" in page
