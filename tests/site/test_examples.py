"""What holds the examples of the pages to the truth does notice what is not true."""

import json
import subprocess
import sys

import pytest

from tests.site.paths import DOCS, pages

from example_blocks import UnclearError, blocks_of, differing_line  # isort: skip


def page(tmp_path, text):
    path = tmp_path / "page.md"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("shown", "said"),
    [
        (["RMSE 12.1 m"], ["RMSE   12.1 m", ""]),
        (["RMSE 12.1 m"], ["RMSE 12.1499 m"]),
        (["a", "...", "wrote x (... s)"], ["a", "b", "c", "wrote x (3.14 s)"]),
        (["...", "1.2e6 (0.9-1.3)"], ["x", "1200400 (0.9-1.3)"]),
        ([" ----  ------"], [" -------  ----"]),
    ],
)
def test_what_is_the_same(shown, said):
    assert differing_line(shown, said) is None


@pytest.mark.parametrize(
    ("shown", "said"),
    [
        (["RMSE 12.1 m"], ["RMSE 12.3 m"]),
        (["RMSE 12.1 m"], ["NEES 12.1 m"]),
        (["RMSE 12.1 m"], ["RMSE 12.1 km"]),
        (["RMSE 12.1 m"], ["RMSE -12.1 m"]),
        (["RMSE 12.1 m"], []),
        (["RMSE 12.1 m"], ["RMSE 12.1 m", "one is lost"]),
        (["a", "c"], ["a", "b", "c"]),
        (["a", "...", "d"], ["a", "b", "c"]),
        (["0 lost"], ["1 lost"]),
    ],
)
def test_what_is_not_the_same(shown, said):
    assert differing_line(shown, said) is not None


def test_a_tolerance_is_a_tolerance():
    assert differing_line(["12.1"], ["12.6"], within=0.05) is None
    assert differing_line(["12.1"], ["13.6"], within=0.05) == "12.1"


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("a\n\n```yaml\nestimators: {}\n```\n", 3),
        ("```bash\nls\n```\n", 1),
        ("```console\nls\n```\n", 2),
        ("<!-- example: skip it -->\n\nwords\n", 3),
        ("<!-- example: sometimes -->\n```console\n$ ls\n```\n", 2),
        ("```console\n$ ls\n", 2),
    ],
)
def test_a_block_that_nothing_runs_is_refused(tmp_path, text, line):
    with pytest.raises(UnclearError) as refused:
        blocks_of(page(tmp_path, text))
    assert refused.value.line == line


def test_blocks_are_read(tmp_path):
    text = (
        "```yaml\n# a/b.yaml: a file\nx: 1\n```\n<!-- example: status 2; within 5 % -->\n"
        "```console\n$ one \\\n    more\nshown\n$ two\n```\n```text\nnot an example\n```\n"
        "<!-- example: file t.csv -->\n```text\n1\n```\n"
    )
    file, console, table = blocks_of(page(tmp_path, text))
    assert file.file == "a/b.yaml" and table.file == "t.csv" and table.text == "1\n"
    assert (console.status, console.within) == (2, 0.05)
    assert [command.text for command in console.commands] == ["one \\\n    more", "two"]
    assert [command.shown for command in console.commands] == [["shown"], []]


def run(tmp_path, text):
    """Run a page as the site does; return lines and what is wrong there."""
    program = (
        "import json, pathlib, sys; sys.path.insert(0, sys.argv[1]); import example_runs as r\n"
        "page = pathlib.Path(sys.argv[2]); print(json.dumps(r._run_page(page, page.parent / 'made')))"
    )
    command = [sys.executable, "-c", program, str(DOCS / "_ext"), str(page(tmp_path, text))]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    return json.loads(done.stdout.splitlines()[-1])


def test_a_page_is_run_from_top_to_bottom(tmp_path):
    text = (
        "```console\n$ quietfix new ship --template ship\n...\n```\n```python\n# m.py\nprint(6 * 7)\n```\n"
        "```console\n$ python m.py | cat\n42\n$ quietfix show ship.yaml\n...\n```\n"
        "<!-- example: status 2 -->\n```console\n$ quietfix show nothing.yaml\n```\n```python\nassert True\n```\n"
    )
    assert run(tmp_path, text) == []


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("\n```console\n$ quietfix new ship --template boat\n```\n", 3, "ended with status 2, not 0"),
        ("```console\n$ echo 12.1\n12.3\n```\n", 2, "does not say '12.3'"),
        ("```python\n1 / 0\n```\n", 1, "ZeroDivisionError"),
    ],
)
def test_what_is_wrong_on_a_page_is_named(tmp_path, text, line, words):
    ((where, what),) = run(tmp_path, text)
    assert where == line and words in what


def test_pages_have_examples():
    found = {path.name: blocks_of(path) for path in pages()}
    assert len(found["own.md"]) > 8 and len(found["start.md"]) > 4
