"""Formulas as MathML, made when the site is built, so that a page loads no script for them."""

from __future__ import annotations

import html
import re

from latex2mathml.converter import convert

_FORMULA = re.compile(
    r'<(?P<tag>span|div) class="arithmatex">\s*\\(?P<kind>[(\[])(?P<latex>.*?)\\[)\]]\s*</(?P=tag)>', re.DOTALL
)
_UNKNOWN = re.compile(r"\\[A-Za-z]+")


def drawn(page: str, name: str) -> str:
    """The HTML of a page with each formula as MathML. Raises ValueError for one that cannot be drawn."""

    def mathml(found: re.Match[str]) -> str:
        latex = html.unescape(found["latex"]).strip()
        block = found["kind"] == "["
        made = convert(latex, display="block" if block else "inline")
        if unknown := _UNKNOWN.search(re.sub(r"<annotation.*?</annotation>", "", made)):
            raise ValueError(f"{name}: the formula {latex} has {unknown[0]}, which latex2mathml does not know")
        return f'<div class="formula">{made}</div>' if block else made

    return _FORMULA.sub(mathml, page)
