"""A text in Markdown as a page: a datasheet, or the sheet of an exercise, to be read in a browser or printed."""

from __future__ import annotations

from testbench.page.html import render


def text_page(kicker: str, text: str) -> str:
    """Return Markdown as one HTML file that fetches nothing; its first heading is the title.

    HTML in the text is shown as it stands, and links that run code are no links.

    Args:
        kicker: above the title: what it is.
        text: Markdown (CommonMark with tables) that begins with a heading.
    """
    from markdown_it import MarkdownIt
    from markupsafe import Markup

    first, _, rest = text.lstrip().partition("\n")
    body, *parts = MarkdownIt("commonmark", {"html": False}).enable("table").render(rest).split("<table>")
    for k, part in enumerate(parts, start=1):
        body += f'<figure class="table"><div class="scroll" tabindex="0" role="region" aria-label="table {k}"><table>'
        body += part.replace("</table>", "</table></div></figure>")
    return render("text.html.j2", kicker=kicker, title=first.lstrip("# ").strip(), body=Markup(body))
