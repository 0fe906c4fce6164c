"""The hook of mkdocs.yml: pages that are generated, links out of docs/, formulas, and samples.

A page is generated from the code (`reference/`), or is a page of the repository's first folder, which the site shows
under a name of its own. docs/ has neither, so each thing stands in one place.
"""

from __future__ import annotations

import os
import posixpath
import re
import sys
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

sys.path.insert(0, str(Path(__file__).parent))  # the modules beside this one

import api
import formulas
import keys
import kinds
import notebooks
import samples
import verbs

ROOT = Path(__file__).resolve().parents[2]
OUTER = {
    "README.md": "index.md",
    "SECURITY.md": "security.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "RELEASE.md": "release.md",
    "deploy/README.md": "deploy.md",
}
"""Pages outside of docs/, and their names in the site."""

GENERATED = {
    "reference/verbs.md": verbs.page,
    "reference/keys.md": keys.page,
    "reference/api.md": api.page,
    "reference/kinds.md": kinds.page,
    "reference/samples.md": samples.page,
}
"""Pages made from the code."""

_LINK = re.compile(r"(\]\()([^)\s:#]+)((?:#[^)\s]*)?\))")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add what docs/ does not have."""
    for outer, inner in OUTER.items():
        files.append(File.generated(config, inner, content=(ROOT / outer).read_text(encoding="utf-8")))
    for inner, page in GENERATED.items():
        files.append(File.generated(config, inner, content=page()))
    files.append(File.generated(config, "site.css", abs_src_path=str(Path(__file__).parent / "site.css")))
    if not os.environ.get("DOCS_WITHOUT_SAMPLES"):
        for name, path in samples.made().items():
            files.append(File.generated(config, f"samples/{name}", abs_src_path=str(path)))
    for name, content in notebooks.pages(run="DOCS_WITHOUT_SAMPLES" not in os.environ).items():
        files.append(File.generated(config, f"notebooks/{name}", content=content))
    _copied.clear()
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let links that leave docs/ lead to where the site has what they name: a page, or a copy of the file."""
    inner = page.file.src_uri
    here = next((outer for outer, name in OUTER.items() if name == inner), f"docs/{inner}")

    def moved(link: re.Match[str]) -> str:
        named = posixpath.normpath(posixpath.join(posixpath.dirname(here), link[2]))
        if not (ROOT / named).exists():
            return link[0]  # mkdocs says whether it leads anywhere
        if named in OUTER:
            target = OUTER[named]
        elif named.startswith("docs/"):
            target = named.removeprefix("docs/")
            if target != inner.replace(".md", ".ipynb"):  # a notebook's page has it to download, all others its page
                target = target.replace(".ipynb", ".md")
        else:
            target = _copy(named, config, files)
        return link[1] + posixpath.relpath(target, posixpath.dirname(inner) or ".") + link[3]

    return _LINK.sub(moved, markdown)


_copied: set[str] = set()


def _copy(named: str, config: MkDocsConfig, files: Files) -> str:
    """The name in the site of a file of the repository, of which the site gets a copy."""
    target = f"files/{named}" if Path(named).suffix else f"files/{named}.txt"
    if target not in _copied:
        _copied.add(target)
        files.append(File.generated(config, target, abs_src_path=str(ROOT / named)))
    return target


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turn formulas into MathML, which browsers draw by themselves."""
    del config, files
    return formulas.drawn(html, page.file.src_uri)
