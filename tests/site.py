"""Check the built site: ``python -m tests.site FOLDER``; ``make docs`` calls it after the build.

Each file of docs has its heading in a page of its own, each public object has one page, internal links and their anchors
exist, no script, style, font or picture comes from elsewhere, and options of commands begin with two hyphens. What tutorial,
how-tos and gallery print shows a failure only where the cell has the tag ``expected-failure`` and the words before announce it;
it shows no escape sequence, progress or rounding error, and no measured time without a label.
"""

from __future__ import annotations

import html
import re
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote, urldefrag

from docs.generate import MEASURED, MEASURED_LABEL, list_objects

DOCS = Path(__file__).parents[1] / "docs"
RUN = ("tutorial", "howto", "generated/gallery")
"""Begins of the paths of pages that show what code printed."""
FAILURE = re.compile(r"\bFalse\b|NOT valid|Traceback \(most recent|UNREACHABLE|✗|not valid\b|no motion:|\n\s*reason: ")
"""Words of what failed."""
ANNOUNCED = re.compile(
    r"\bfail|\berror\b|\bnot\b|exceed|impossible|too (?:far|fast|short|long)|contact with|refuse|violate", re.I
)
"""Words that announce a failure."""
RAW = {
    "an escape sequence": re.compile(r"[\x00-\x08\x0b-\x1f]|\[\d+(?:;\d+)*[mKJ]|\[\?25"),
    "a display that moves": re.compile(r"[\u2800-\u28ff]|\bcompil(?:ing|ed \d)|━ *\d+/\d+"),
    "a rounding error": re.compile(r"\d(?:\.\d+)?e-(?:1[3-9]|[2-9]\d|\d{3})\b"),
}
"""What no output shows."""
VOID = {"area", "base", "br", "col", "embed", "hr", "img", "input", "link", "meta", "source", "track", "wbr"}
"""Elements without an end."""


class Output(NamedTuple):
    """What a cell or an example printed, whether the cell expects a failure, and the paragraph before."""

    text: str
    expects: bool
    before: str


class Page(HTMLParser):
    """The links, sources, names of anchors, first heading and outputs of a page."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.sources: list[str] = []
        self.anchors: set[str] = set()
        self.heading, self._open = "", False
        self.outputs: list[Output] = []
        self._roles: list[tuple[str, str]] = []
        self._before, self._fresh = "", False
        self.feed(
            re.sub(r' srcdoc="[^"]*"', "", file.read_text(encoding="utf-8"))
        )  # a viewer, which is no page of the site
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {key: value or "" for key, value in attrs}
        self.anchors |= {given[key] for key in ("id", "name") if key in given}
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        if tag in ("script", "img", "iframe", "link") and given.get("rel") != "canonical":
            self.sources.append(given.get("src") or given.get("href", ""))
        self._open = self._open or (tag == "h1" and not self.heading)
        self._begin(tag, given.get("class", "").split())

    def _begin(self, tag: str, classes: list[str]) -> None:
        """Note what an element is for: an output, a paragraph, or nothing that is read."""
        roles = {role for _, role in self._roles}
        role, inside = "", "output" in roles
        if tag in ("script", "style", "svg"):
            role = "skip"
        elif {"cell_output", "highlight-text"} & {*classes} and not inside:
            role = "output"
            self.outputs.append(Output("", "expects" in roles, self._before))
        elif "tag_expected-failure" in classes:
            role = "expects"
        elif tag in ("p", "li") and not inside:
            role, self._fresh = "words", True
        if tag not in VOID:
            self._roles.append((tag, role))

    def handle_endtag(self, tag: str) -> None:
        self._open = self._open and tag != "h1"
        last = max((i for i, (name, _) in enumerate(self._roles) if name == tag), default=len(self._roles))
        del self._roles[last:]

    def handle_data(self, data: str) -> None:
        self.heading += data if self._open else ""
        roles = {role for _, role in self._roles}
        if "output" in roles and "skip" not in roles:
            self.outputs[-1] = self.outputs[-1]._replace(text=self.outputs[-1].text + data)
        elif "words" in roles and (data.strip() or not self._fresh):
            self._before, self._fresh = data if self._fresh else self._before + data, False


def judge_outputs(page: Page) -> list[str]:
    """Return what is wrong with the outputs of a page."""
    faults = []
    for output in page.outputs:
        if failure := FAILURE.search(output.text):
            words = output.text[max(0, failure.start() - 30) : failure.end() + 40].strip().replace("\n", " ")
            if not output.expects:
                faults.append(f"shows a failure, and its cell is not tagged expected-failure: {words}")
            elif not ANNOUNCED.search(output.before):
                faults.append(f"shows a failure that the words before do not announce: {output.before}")
        faults += [f"shows {what}: {found[0]!r}" for what, one in RAW.items() if (found := one.search(output.text))]
        if (found := MEASURED.search(output.text)) and MEASURED_LABEL not in output.before:
            faults.append(f"shows a time that is not labelled {MEASURED_LABEL!r}: {found[0]}")
    return faults


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
        if where.as_posix().startswith(RUN):
            faults += [f"{where}: {words}" for words in judge_outputs(page)]
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
    print("\n".join(found) or "every page and every link is there, and every output shows what works")
    sys.exit(bool(found))
