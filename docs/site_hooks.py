"""Hooks of the documentation site: pages that lie in the repository's root are part of it.

README.md becomes the first page; its links, and those from `docs/` back to the root, are rewritten,
so that the same text works on the repository's page and on the site.
"""

import pathlib
import re
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = pathlib.Path(__file__).resolve().parents[1]

PAGES = {
    "README.md": "index.md",
    "BUILD.md": "BUILD.md",
    "CHANGELOG.md": "CHANGELOG.md",
    "CONTRIBUTING.md": "CONTRIBUTING.md",
    "SECURITY.md": "SECURITY.md",
    "CITATION.cff": "CITATION.cff",
    "LICENSE": "LICENSE.txt",
    "notebooks/losses.ipynb": "notebooks/losses.ipynb",
    "notebooks/predict.ipynb": "notebooks/predict.ipynb",
    **{f"examples/{path.name}": f"examples/{path.stem}.txt" for path in ROOT.glob("examples/*.py")},
}
"""File in the root -> its place in the site."""

_LINK = re.compile(r"(?<=\]\()[^)\s]+(?=\))")


def on_files(files: Files, config: Any) -> Files:
    """Adds the root's pages."""
    for source, place in PAGES.items():
        text = (ROOT / source).read_text()
        if place.endswith(".md"):
            text = _LINK.sub(lambda match: _from_root(match[0]), text)
        files.append(File.generated(config, place, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Rewrites links from a page in `docs/` to the root's pages."""
    depth = page.file.src_uri.count("/")
    if page.file.src_uri in PAGES.values():
        return markdown
    return _LINK.sub(lambda match: _to_root(match[0], depth), markdown)


def _from_root(link: str) -> str:
    path, hash_, anchor = link.partition("#")
    return PAGES.get(path, path.removeprefix("docs/")) + hash_ + anchor


def _to_root(link: str, depth: int) -> str:
    path, hash_, anchor = link.partition("#")
    up = "../" * (depth + 1)
    if path.startswith(up) and path.removeprefix(up) in PAGES:
        return "../" * depth + PAGES[path.removeprefix(up)] + hash_ + anchor
    return link
