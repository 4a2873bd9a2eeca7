"""What the pages promise is there: links and anchors, commands and their options, the rooms, the example case."""

import io
import re
import shlex
from contextlib import redirect_stdout
from functools import cache
from pathlib import Path

import pytest

from oneframe import __version__
from oneframe.case.case_file import case_from_text
from oneframe.commands.__main__ import COMMANDS, dispatch
from oneframe.dataset.options import checked_options

ROOT = Path(__file__).resolve().parents[1]
PAGES = [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")]
OF_TODAY = [page for page in PAGES if page.name != "CHANGELOG.md"]
"""The pages that speak of nothing that is gone."""
README_LINES = 125
FENCE = re.compile(r"^```(\S*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"!?\[(?:[^\[\]]|\[[^\]]*\])*\]\(([^)\s]+)\)")


def prose(page: Path) -> str:
    """The page without its blocks of code and its literals."""
    return re.sub(r"`[^`\n]*`", "``", FENCE.sub("", page.read_text(encoding="utf-8")))


@cache
def anchors(page: Path) -> set[str]:
    """Anchors of a page's headings, as GitHub and MyST make them."""
    headings = re.findall(r"^#+ (.+)$", FENCE.sub("", page.read_text(encoding="utf-8")), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def names(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("page", PAGES, ids=names)
def test_links_lead_somewhere(page):
    for target in LINK.findall(prose(page)):
        if re.match(r"https?://", target):
            continue
        path, _, anchor = target.partition("#")
        there = (page.parent / path).resolve() if path else page
        assert there.exists(), f"{target}: there is no {there}"
        assert there.is_relative_to(ROOT), target
        assert not anchor or anchor in anchors(there), f"{target}: {there.name} has {sorted(anchors(there))}"


def test_no_link_goes_unseen():
    """An empty text is a link in the site and nothing at all elsewhere."""
    empty = [(names(page), found) for page in PAGES for found in re.findall(r"(?<!!)\[\]\([^)]*\)", prose(page))]
    assert empty == []


def test_all_pages_and_pictures_are_linked():
    found = {
        (page.parent / target.partition("#")[0]).resolve() for page in PAGES for target in LINK.findall(prose(page))
    }
    table = set(re.findall(r"^[\w-]+$", (ROOT / "docs" / "index.md").read_text(), re.MULTILINE))
    assert {page.stem for page in (ROOT / "docs").glob("*.md")} - {"index"} <= table
    pictures = {path for path in (ROOT / "docs").rglob("*") if path.suffix in (".png", ".jpg", ".svg")}
    # a chart is one picture in four files: PNG and SVG, for light and for dark pages
    assert {path.stem.removesuffix("-dark") for path in pictures} <= {path.stem for path in found}


def commands() -> list[tuple[str, str]]:
    """Every line of a block of code or a literal that calls ``oneframe``, a script or make, with its page."""
    found = []
    for page in OF_TODAY:
        text = page.read_text(encoding="utf-8")
        blocks = [body for kind, body in FENCE.findall(text) if kind in ("sh", "bash")]
        lines = [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]
        lines += re.findall(r"`([^`\n]+)`", FENCE.sub("", text))
        found += [
            (names(page), line)
            for line in lines
            if re.match(r"(\w+=\S+ )*(oneframe \w|make \w|blender -b|\S*python3? \S+/\S+\.py)", line)
        ]
    return found


@cache
def options_of(command: str) -> set[str]:
    """The options of a command of the program ``oneframe``, or of the program itself, from its own parser."""
    printed = io.StringIO()
    with redirect_stdout(printed), pytest.raises(SystemExit):
        dispatch([*command.split(), "--help"])
    return set(re.findall(r"(?<![\w-])--[a-z][\w-]*", printed.getvalue()))


@pytest.mark.parametrize(("page", "line"), commands(), ids=lambda value: value[:60])
def test_commands_exist(page, line):
    words = shlex.split(line, comments=True)
    while "=" in words[0]:
        words.pop(0)
    if words[0] == "make":
        targets = re.findall(r"^([\w-]+):(?!=)", (ROOT / "Makefile").read_text(), re.MULTILINE)
        assert {word for word in words[1:] if "=" not in word} <= set(targets)
        return
    if words[0] == "oneframe":
        command, arguments = ("", words[1:]) if words[1].startswith("-") else (words[1], words[2:])
        assert command in ("", *COMMANDS)
    else:
        path = next(word for word in words if word.endswith(".py"))
        if words[0] == "blender":
            assert words[:3] == ["blender", "-b", "-P"]
            assert words[4:5] == ["--"], "Blender takes arguments before -- for its own"
        arguments = words[words.index(path) + 1 :]
        if Path(path).name == "oneframe.py":
            command, *arguments = (word for word in arguments if word != "--")
            assert command in COMMANDS
        else:
            assert path == "scripts/render_dataset.py"
            command = "render"
    named = {word.partition("=")[0] for word in arguments if word.startswith("--") and word != "--"}
    assert named - options_of(command) == set()


def test_options_named_in_the_prose_exist():
    known = {option for command in ("", *COMMANDS) for option in options_of(command)}
    known |= set(re.findall(r"--[a-z][\w-]*", (ROOT / "scripts" / "slurm_array.sh").read_text(encoding="utf-8")))
    for page in OF_TODAY:
        named = set(re.findall(r"`(--[a-z][\w-]*)", FENCE.sub("", page.read_text(encoding="utf-8"))))
        assert named <= known, names(page)


def test_the_example_case_is_a_case(tmp_path):
    page = (ROOT / "docs" / "case-file.md").read_text(encoding="utf-8")
    (text,) = (body for kind, body in FENCE.findall(page) if kind == "toml")
    case = case_from_text(text, tmp_path / "case.toml")
    assert case.messages == ()
    assert case.distortion is not None
    assert len(case.structures) == len(case.landmarks) == 1
    checked_options(case.dataset, "docs/case-file.md")
    # every table and key is in the example
    assert len(case.alignment.table()) == 8


def test_the_first_case_is_a_case(tmp_path):
    page = (ROOT / "docs" / "getting-started.md").read_text(encoding="utf-8")
    (text,) = (body for kind, body in FENCE.findall(page) if kind == "toml")
    assert case_from_text(text, tmp_path / "case.toml").messages == ()


def test_the_map_has_all_rooms():
    text = (ROOT / "docs" / "developing.md").read_text(encoding="utf-8")
    tree = next(body for kind, body in FENCE.findall(text) if kind == "text")
    rooms = [path.parent for top in ("pipeline", "blender_addon") for path in (ROOT / top).rglob("*/__init__.py")]
    missing = [room.relative_to(ROOT).as_posix() for room in rooms if not re.search(rf"\b{room.name}/", tree)]
    assert missing == []


def test_the_table_of_commands_is_right():
    text = (ROOT / "docs" / "getting-started.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| `oneframe (\w+)` \|", text, re.MULTILINE) == list(COMMANDS)


def test_every_promise_has_its_test():
    page = (ROOT / "docs" / "guarantees.md").read_text(encoding="utf-8")
    assert len(page.splitlines()) <= 60
    tests = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("test_*.py"))
    promised = [re.findall(r"`(test_\w+)`", line) for line in page.splitlines() if line.startswith("| **")]
    assert all(promised)
    assert [name for names in promised for name in names if f"def {name}(" not in tests] == []


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= README_LINES


def test_the_citation_has_the_version():
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(r"^version: (\S+)$", citation, re.MULTILINE)[1] == __version__
