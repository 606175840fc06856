"""Pages name what there is: links lead somewhere, commands and options exist."""

import re
from functools import cache

import pytest
import typer.main

from quietfix.diagrams.commands.command_line import app
from tests.site.paths import DOCS, ROOT, pages

PAGES = {str(page.relative_to(ROOT)): page for page in pages()}
LINK = re.compile(r"\]\((?!https?:|mailto:)([^)\s#]*)(#[^)\s]*)?\)")


def text_of(page, without_code=True):
    text = page.read_text(encoding="utf-8")
    return re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE) if without_code else text


def anchors(page):
    """Return the anchors that headings of a page make."""
    heads = re.findall(r"^#+ +(.*)$", text_of(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).strip().replace(" ", "-") for head in heads}


@pytest.mark.parametrize("name", PAGES)
def test_links_lead_somewhere(name):
    page = PAGES[name]
    for path, anchor in LINK.findall(text_of(page)):
        target = (DOCS / path[1:] if path.startswith("/") else page.parent / path).resolve() if path else page
        assert target.exists(), f"{name}: {path}"
        if anchor and target.suffix == ".md":
            assert anchor[1:] in anchors(target), f"{name}: {path}{anchor}"


@cache
def commands():
    """Options of every command."""
    group = typer.main.get_command(app)
    return {
        name: {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}
        | {"--help", "-h"}
        for name, command in group.commands.items()
    }


def test_options_are_found():
    assert {"run", "compare", "report"} <= set(commands()) and "--trials" in commands()["run"]


@pytest.mark.parametrize("name", PAGES)
def test_commands_and_options_exist(name):
    """Also those that no example runs: in a sentence, in a table, where a cluster would be needed."""
    text = text_of(PAGES[name], without_code=False).replace("\\\n", " ")
    for command, rest in re.findall(r"(?:`|\$ |\| |; |^    )quietfix ([a-z]+)\b([^`\n|]*)", text, re.MULTILINE):
        assert command in commands(), f"{name}: quietfix {command}"
        for option in re.findall(r"(?<![\w-])--[a-z][a-z-]*", rest):
            assert option in commands()[command], f"{name}: quietfix {command} {option}"


def test_every_page_for_readers_is_named_in_the_readme_or_an_index():
    named = text_of(ROOT / "README.md", without_code=False) + (DOCS / "tasks" / "index.md").read_text()
    for page in (DOCS / "tasks").glob("*.md"):
        assert page.stem in named, page.name
