"""Hook of MkDocs: equations become MathML while the site is built, so that a page needs no script to show them."""

import html
import re

from latex2mathml.converter import convert

_EQUATION = re.compile(r'<(span|div) class="arithmatex">(.*?)</\1>', re.DOTALL)


def on_page_content(content: str, **_others: object) -> str:
    """Replace the equations of a page, which arithmatex has marked; called by MkDocs."""
    return _EQUATION.sub(_drawn, content)


def _drawn(found: "re.Match[str]") -> str:
    marked = html.unescape(found[2]).strip()
    display = "block" if marked.startswith("\\[") else "inline"
    return str(convert(marked[2:-2].strip(), display=display))
