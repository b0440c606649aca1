"""Check a built site: links within it, alternative text of figures, names of options, nothing from a network.

python docs/check_site.py build/docs/html
"""

from __future__ import annotations

import re
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class Page(HTMLParser):
    """What a page links to, loads and contains."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.without_text: list[str] = []
        self.equations = 0
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note a tag."""
        named = {key: value or "" for key, value in attrs}
        self.anchors |= {named[key] for key in ("id", "name") if key in named}
        if tag == "a" and "href" in named:
            self.links.append(named["href"])
        if tag in ("img", "script", "iframe", "source") and "src" in named:
            self.loaded.append(named["src"])
        if tag == "link" and named.get("rel") in ("stylesheet", "preload", "icon"):
            self.loaded.append(named["href"])
        if tag == "img" and len(named.get("alt", "").split()) < 3:
            self.without_text.append(named.get("src", "?"))
        self.equations += tag == "math"

    def has(self, place: str) -> bool:
        """Whether a link can point to this place on the page."""
        return place in ("", "top") or place in self.anchors


def complaints(site: Path) -> list[str]:
    """What is wrong with a site, one line each.

    Args:
        site: its folder.
    """
    pages = {
        path: Page(path.read_text("utf-8")) for path in sorted(site.rglob("*.html")) if "_static" not in path.parts
    }
    found = []
    for path, page in pages.items():
        where = path.relative_to(site)
        dashes = re.findall(r"\(–[a-z][\w-]*", path.read_text("utf-8"))
        found += [f"{where}: an option has become a dash: {each})" for each in dashes]
        found += [f"{where}: figure without alternative text of three words: {each}" for each in page.without_text]
        for link in [*page.links, *page.loaded]:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                if link in page.loaded and parts.scheme != "data":
                    found.append(f"{where}: loads from a network: {link}")
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if not target.exists():
                found.append(f"{where}: broken link: {link}")
            elif link in page.links and target in pages and not pages[target].has(unquote(parts.fragment)):
                found.append(f"{where}: no such place on the page: {link}")
    for style in (*site.rglob("*.css"), *site.rglob("*.js")):
        for address in re.findall(r"(?:url\(|@import |import\()\s*['\"]?(https?://[^'\")]+)", style.read_text("utf-8")):
            found.append(f"{style.relative_to(site)}: loads from a network: {address}")
    if not any(page.equations for page in pages.values()):
        found.append("no page has an equation in MathML")
    return found


if __name__ == "__main__":
    wrong = complaints(Path(sys.argv[1]).resolve())
    print(*wrong, sep="\n", end="\n" if wrong else "")
    sys.exit(bool(wrong))
