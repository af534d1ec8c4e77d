"""Check the built site: ``python -m tests.site FOLDER``; ``make docs`` calls it after the build.

Each file of docs has its heading in a page of its own, each public object has one page, internal links and their anchors
exist, no script, style, font or picture comes from elsewhere, and options of commands begin with two hyphens.
"""

from __future__ import annotations

import html
import re
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urldefrag

from docs.generate import list_objects

DOCS = Path(__file__).parents[1] / "docs"


class Page(HTMLParser):
    """The links, sources, names of anchors and first heading of a page."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.sources: list[str] = []
        self.anchors: set[str] = set()
        self.heading, self._open = "", False
        self.feed(file.read_text(encoding="utf-8"))
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {key: value or "" for key, value in attrs}
        self.anchors |= {given[key] for key in ("id", "name") if key in given}
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        if tag in ("script", "img", "iframe", "link") and given.get("rel") != "canonical":
            self.sources.append(given.get("src") or given.get("href", ""))
        self._open = self._open or (tag == "h1" and not self.heading)

    def handle_endtag(self, tag: str) -> None:
        self._open = self._open and tag != "h1"

    def handle_data(self, data: str) -> None:
        self.heading += data if self._open else ""


def find_faults(site: Path) -> list[str]:
    """Return what is wrong with a site."""
    pages, faults = {file.resolve(): Page(file) for file in sorted(site.rglob("*.html"))}, []
    for file in sorted(DOCS.rglob("*.md")):
        if file.is_relative_to(DOCS / "_build"):
            continue
        title = re.search(
            r"^# (.+)$", re.sub(r"^---\n.*?\n---\n", "", file.read_text(encoding="utf-8"), flags=re.S), re.M
        )
        page = pages.get((site / file.relative_to(DOCS).with_suffix(".html")).resolve())
        plain = "" if title is None else re.sub(r"[`*_\\]|\]\([^)]*\)|\[", "", title[1])
        if (
            page is None
            or not plain
            or re.sub(r"[*_\\]", "", page.heading.rstrip("¶#")).strip() != html.unescape(plain).strip()
        ):
            faults.append(f"{file.relative_to(DOCS)}: its heading {plain!r} is not that of its page")
    for file in sorted((DOCS / "api").glob("*.md")):
        for *_, name, _ in list_objects(file.read_text(encoding="utf-8")):
            if (site / "generated" / "reference" / f"{name}.html").resolve() not in pages:
                faults.append(f"{name} has no page")
    for file, page in pages.items():
        where = file.relative_to(site.resolve())
        faults += [f"{where}: loads {source}" for source in page.sources if re.match(r"(https?:)?//", source)]
        text = file.read_text(encoding="utf-8")
        faults += [
            f"{where}: {word}, which begins with a dash for --" for word in re.findall(r"[\s>(](–[a-z][\w-]*)", text)
        ]
        for link in page.links:
            path, anchor = urldefrag(link)
            if re.match(r"[a-z]+:", link):
                continue
            target = file if not path else (file.parent / unquote(path)).resolve()
            if not target.exists():
                faults.append(f"{where}: links to {link}, which is not there")
            elif anchor and target in pages and unquote(anchor) not in pages[target].anchors:
                faults.append(f"{where}: links to {link}, whose anchor is not there")
    return faults


if __name__ == "__main__":
    found = find_faults(Path(sys.argv[1]))
    print("\n".join(found) or "every page and every link is there")
    sys.exit(bool(found))
