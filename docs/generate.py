"""Pages of the site that are made of the code: one for each public object and command, and the gallery of examples.

``make docs`` calls `write_pages`; the pages are in docs/generated, which git ignores.
"""

from __future__ import annotations

import contextlib
import importlib
import inspect
import io
import os
import re
import runpy
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import typer
from plotly.offline import get_plotlyjs

DOCS = Path(__file__).parent
ROOT, OUT = DOCS.parent, DOCS / "generated"
LISTED = re.compile(r"```\{eval-rst\}\n(.*?)```", re.S)
"""The blocks of docs/api that name objects for Sphinx."""
MOST_EXAMPLE_LINES = 14
"""Longest code block of the documentation that is shown as the example of an object."""
MEASURED = re.compile(r"µs\b|\d [nm]s\b|per second\b")
"""Units of times that a page measured while it was built."""
MEASURED_LABEL = "measured when this page was built"
"""Words before an output with such times."""
ARGUMENTS = {"batch": ["3000"]}
"""Arguments of examples that are shown, to be quick."""
GALLERY = {
    "Move": [
        ("An arm in its shelf", "shelf", "gallery/shelf"),
        ("Pick and place, rounded corners", "zones", "../howto/pick"),
        ("An open container at 15°", "cup", "../limits"),
        ("A line of your arm", "own_urdf", "gallery/own_urdf"),
        ("Stop, and go on slowly", "replan", "gallery/replan"),
        ("To a laser spot", "laser", "../howto/laser"),
        ("Two arms carry a bar", "bar", "../howto/bar"),
    ],
    "Follow": [
        ("Pipe saddle, chosen torch turn", "saddle", "gallery/pipe_saddle"),
        ("Weld seam for ROS 2", "seam", "gallery/seam_to_ros"),
        ("Seam on a positioner", "positioner", "../howto/positioner"),
        ("Stream beside hard replacement", "stream", "gallery/policy_stream"),
    ],
    "Reach": [
        ("Where the tool points down", "reach", "gallery/reachability_map"),
        ("A million targets", "", "gallery/batch"),
    ],
    "Prove": [("Curve, proved bound and limit", "certificate", "../tutorial/certificate")],
    "Compare": [
        ("A report's first screen", "report", "../howto/compare"),
        ("A report from Python", "", "gallery/report"),
        ("All laws on one line", "", "gallery/compare_laws"),
        ("Your own IK method", "", "gallery/own_method"),
        ("Plug-ins in one file", "", "plugins"),
    ],
}
"""Cards of the gallery by task: title, picture of docs/pictures, and page. Each example is in one of them."""


def write_pages() -> None:
    """Write all generated pages anew."""
    shutil.rmtree(OUT, ignore_errors=True)
    for folder in ("reference", "commands", "gallery", "static"):
        (OUT / folder).mkdir(parents=True)
    (OUT / "static" / "plotly.min.js").write_text(get_plotlyjs(), encoding="utf-8")  # no page loads it from elsewhere
    examples = find_examples()
    for page in sorted((DOCS / "api").glob("*.md")):
        for _, _, name, thing in list_objects(page.read_text(encoding="utf-8")):
            text = describe_object(name, thing, examples.get(name.rpartition(".")[2], []))
            (OUT / "reference" / f"{name}.md").write_text(text, encoding="utf-8")
    write_command_line()
    write_gallery()


# ---------------------------------------------------------------- one page for each object


def list_objects(text: str) -> list[tuple[str, str, str, Any]]:
    """Return block, directive, qualified name and object of everything that a page of docs/api lists."""
    found = []
    for block in LISTED.findall(text):
        for kind, module, options in re.findall(r"\.\. (auto\w+):: (\S+)\n((?:   :.*\n)*)", block):
            if kind == "autofunction":
                module, _, name = module.rpartition(".")
                found.append((block, kind, f"{module}.{name}", getattr(importlib.import_module(module), name)))
                continue
            given, left = (re.search(rf":{key}:(.*)", options) for key in ("members", "exclude-members"))
            whole = importlib.import_module(module)
            own = [n for n, v in vars(whole).items() if n[0] != "_" and getattr(v, "__module__", "") == module]
            names = re.findall(r"\w+", given[1] if given else "") or list(getattr(whole, "__all__", own))
            names = [name for name in names if name not in re.findall(r"\w+", left[1] if left else "")]
            found += [(block, kind, f"{module}.{name}", getattr(whole, name)) for name in names]
    return [one for one in found if callable(one[3])]


def summarize(thing: Any) -> str:
    """Return the first line of a docstring."""
    return " ".join((inspect.getdoc(thing) or "").partition("\n\n")[0].split())


def list_reference(text: str) -> str:
    """Return a page of docs/api with a table of links in place of the blocks that Sphinx would expand."""
    for block in LISTED.findall(text):
        rows = [(name, thing) for own, _, name, thing in list_objects(text) if own == block]
        cells = [
            (f"[`{name.rpartition('.')[2]}`](../generated/reference/{name}.md)", summarize(thing))
            for name, thing in rows
        ]
        table = "".join(f"| {link} | {words.replace('|', chr(92) + '|')} |\n" for link, words in cells)
        text = text.replace(f"```{{eval-rst}}\n{block}```\n", f"| | |\n|---|---|\n{table}\n")
    return text


def find_examples() -> dict[str, list[tuple[str, str]]]:
    """Return the code blocks that call a name, with their pages: that of the README, then the shortest, plug-ins last."""
    found: dict[str, list[tuple[str, str]]] = {}
    for page in (ROOT / "README.md", *sorted(DOCS.glob("*.md"))):
        for code in re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.S):
            for name in set(re.findall(r"\b(\w+)\(", code)) | set(re.findall(r"\b([A-Z]\w+)\.", code)):
                found.setdefault(name, []).append((page.stem, code))

    def rank(block: tuple[str, str]) -> tuple[bool, bool, int]:
        page, code = block
        return page != "README", '"./' in code, code.count("\n")

    return {name: sorted(blocks, key=rank) for name, blocks in found.items()}


def describe_object(name: str, thing: Any, examples: list[tuple[str, str]]) -> str:
    """Return the page of an object: an example, its documentation, and the pages that use it."""
    directive = ".. autoclass::" if inspect.isclass(thing) else ".. autofunction::"
    members = (
        "\n   :members:\n   :inherited-members: object, tuple, str, Exception, LookupError, ABC"
        if inspect.isclass(thing)
        else ""
    )
    short = [code for _, code in examples if code.count("\n") <= MOST_EXAMPLE_LINES][:1]
    example = f"For example:\n\n```python\n{short[0]}```\n\n" if short else ""
    text = f"# {name}\n\n{example}```{{eval-rst}}\n{directive} {name}{members}\n```\n"
    if pages := sorted({page for page, _ in examples} - {"README"}):
        text += f"\nUsed in: {', '.join(f'[{page}](../../{page}.md)' for page in pages)}.\n"
    return text


# ---------------------------------------------------------------- the command line


def write_command_line() -> None:
    """Write the list of all commands, and a page for each."""
    from benchmarks.cli.app import app

    rows = ""
    for words, command in walk("optik", typer.main.get_command(app)):
        name = words.removeprefix("optik ").replace(" ", "_")
        (OUT / "commands" / f"{name}.md").write_text(describe_command(words, command), encoding="utf-8")
        first = " ".join(inspect.cleandoc(command.help or "").partition("\n\n")[0].split())
        rows += f"| [`{words}`](commands/{name}.md) | {first} |\n"
    text = f"Each command prints its page with `--help`.\n\n| | |\n|---|---|\n{rows}"
    (OUT / "command_line.md").write_text(f"# Command line\n\n{text}", encoding="utf-8")


def describe_command(words: str, command: Any) -> str:
    """Return the page of a command, with its options in the order of their panels."""
    text = f"# {words}\n\n{inspect.cleandoc(command.help or '')}\n"
    if command.epilog:
        text += f"\n{command.epilog}\n"
    panels: dict[str, list[str]] = {}
    for p in command.params:
        panel = getattr(p, "rich_help_panel", None) or ("Arguments" if p.param_type_name == "argument" else "Options")
        typed = ", ".join(f"`{flag}`" for flag in p.opts) if p.param_type_name == "option" else f"`{p.metavar}`"
        default = "required" if p.required else "" if p.default in (None, "", False, ()) else f"`{p.default}`"
        words_of = " ".join((getattr(p, "help", "") or "").split()).replace("|", "\\|")
        panels.setdefault(panel, []).append(f"| {typed} | {words_of} | {default} |\n")
    for panel, rows in panels.items():
        text += f"\n**{panel}**\n\n| | | default |\n|---|---|---|\n{''.join(rows)}"
    return text


def walk(words: str, command: Any) -> list[tuple[str, Any]]:
    """Return all commands that are no groups, with the words that call them."""
    inner = getattr(command, "commands", None)
    if inner is None:
        return [(words, command)]
    return [each for name in command.list_commands(None) for each in walk(f"{words} {name}", inner[name])]


# ---------------------------------------------------------------- the gallery


def write_gallery() -> None:
    """Run each example, and write its page: a picture, what it prints, its code, and a download; and a card for each task."""
    cards = {card[2]: card for task in GALLERY.values() for card in task}
    for file in sorted((ROOT / "examples").glob("*.py")):
        first = inspect.cleandoc(file.read_text(encoding="utf-8").split('"""')[1]).splitlines()[0]
        printed, viewer = run_example(file)
        title, name, _ = cards[f"gallery/{file.stem}"]
        picture = viewer or (f"![{title}](../../pictures/{name}.webp)\n" if name else "")
        times = f", with times that were {MEASURED_LABEL}" if MEASURED.search(printed) else ""
        link = f"../../../examples/{file.name}"
        (OUT / "gallery" / f"{file.stem}.md").write_text(
            f"# {title}\n\n{first}\n\n{picture}\nIt prints{times}:\n\n```text\n{printed}```\n\n"
            f"{{download}}`{file.name} <{link}>`:\n\n```{{literalinclude}} {link}\n```\n",
            encoding="utf-8",
        )
    plugins = "".join(describe_plugin(file) for file in sorted((ROOT / "examples" / "plugins").glob("*.*")))
    head = "By task. Pages of examples have their code, what it prints, and a download.\n"
    pages = "\n".join(page for page in cards if not page.startswith(".."))
    toctree = f"```{{toctree}}\n:hidden:\n\n{pages}\n```\n"
    rows = "".join(
        f"## {task}\n\n::::{{grid}} 1 2 3 3\n:gutter: 2\n{''.join(map(describe_card, cards))}::::\n\n"
        for task, cards in GALLERY.items()
    )
    page = f"# Gallery\n\n{head}\n{toctree}\n{rows}"
    (OUT / "gallery.md").write_text(page, encoding="utf-8")
    words = "Each file adds one thing to optik. [Extending](../extending.md) has the rules.\n"
    (OUT / "plugins.md").write_text(f"# Plug-ins in one file\n\n{words}\n{plugins}", encoding="utf-8")


def describe_card(card: tuple[str, str, str]) -> str:
    """Return a card of the gallery."""
    title, picture, page = card
    image = f":img-top: ../pictures/{picture}.webp\n:img-alt: {title}\n" if picture else ""
    return f":::{{grid-item-card}} {title}\n:link: {page}\n:link-type: doc\n{image}:::\n"


def run_example(file: Path) -> tuple[str, str]:
    """Return what an example prints, and the viewer of its last plan as HTML."""
    from optik.view.page import Page, make_page
    from planners import Plan
    from planners.motion.show import show_motion

    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()) as out:
        before, argv = os.getcwd(), sys.argv
        os.chdir(folder)
        sys.argv = [str(file), *ARGUMENTS.get(file.stem, [])]
        try:
            found = runpy.run_path(str(file), run_name="__main__")
        finally:
            os.chdir(before)
            sys.argv = argv
    plans = [value for value in found.values() if isinstance(value, Plan) and value.has_motion]
    printed = out.getvalue().replace(folder, ".")
    if not plans:
        return printed, ""
    return printed, raw_html(Page(make_page(show_motion(plans[-1])))._repr_html_())


def raw_html(html: str) -> str:
    """Return HTML as a block of a page."""
    return f"````{{raw}} html\n{html}\n````\n"


def describe_plugin(file: Path) -> str:
    """Return the section of a plug-in: its first lines as text, and a download."""
    if file.suffix not in (".py", ".toml"):
        return ""
    text = file.read_text(encoding="utf-8")
    words = inspect.cleandoc(text.split('"""')[1]) if file.suffix == ".py" else text.splitlines()[0].lstrip("# ")
    words = words.replace("``", "`")
    return f"## {file.stem}\n\n{words}\n\n{{download}}`{file.name} <../../examples/plugins/{file.name}>`\n\n"
