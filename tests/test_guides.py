"""What README and the guides show runs, pictures are made by the blocks above them, and each page is short.

``GUIDES_WRITE=1 python -m pytest tests/test_guides.py`` puts the pictures that the blocks make into
``examples/guides/pictures``, and the table of options into its guide.
"""

import os
import re
import shutil

import pytest
from helpers.guides import GUIDES, PAGES, ROOT, run

from meshflow.cli.tables import options_table

PICTURES = ROOT / "examples" / "guides" / "pictures"
EMBEDDED = re.compile(r"!\[.*?\]\((.*?)\)", re.S)
LINKED = re.compile(r"\]\(([^)\s]+)\)")


def name(page):
    return page.stem


def headings(page):
    """The anchors that a page has."""
    titles = re.findall(r"^#+ (.*)", page.read_text(), re.M)
    return [re.sub(r"[^\w -]", "", title).lower().replace(" ", "-") for title in titles]


@pytest.mark.long
@pytest.mark.needs_gl
@pytest.mark.parametrize("page", PAGES, ids=name)
def test_the_blocks_of_a_page_run_and_make_its_pictures(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(ROOT / "data", "data", ignore=shutil.ignore_patterns("__pycache__"))
    run(page)
    for shown in EMBEDDED.findall(page.read_text()):
        if shown.startswith("pictures/"):
            made = tmp_path / shown.removeprefix("pictures/")
            assert made.stat().st_size < 120_000
            if "GUIDES_WRITE" in os.environ:
                shutil.copy(made, PICTURES)


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_links_and_pictures_of_a_page_lead_to_files(page):
    for target in LINKED.findall(page.read_text()):
        if not re.match(r"https?://", target):
            there, _, heading = target.partition("#")
            file = page.parent / there if there else page
            assert file.exists(), target
            assert not heading or heading in headings(file), target


def test_pictures_of_guides_are_shown_and_small():
    shown = {picture for page in GUIDES for picture in EMBEDDED.findall(page.read_text())}
    for picture in PICTURES.iterdir():
        assert f"pictures/{picture.name}" in shown
        assert picture.stat().st_size < 120_000


@pytest.mark.parametrize("page", GUIDES, ids=name)
def test_a_guide_is_shorter_than_a_hundred_and_fifty_lines(page):
    assert page.read_text().count("\n") < 150


def test_the_readme_is_short_and_leads_to_every_guide():
    text = (ROOT / "README.md").read_text()
    assert text.count("\n") <= 150
    assert max(map(len, text.splitlines())) <= 100
    assert len(text.encode()) <= 12_000
    pages = [text, *(guide.read_text() for guide in GUIDES)]
    assert all(any(f"{guide.name})" in page for page in pages) for guide in GUIDES)


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_commands_that_print_the_numbers_of_a_page_name_tests_that_exist(page):
    for file in re.findall(r"(?:tests|examples)/\w+\.py", page.read_text()):
        assert (ROOT / file).exists(), file


def test_the_table_of_parameters_is_what_the_command_prints(capsys):
    guide = ROOT / "examples" / "guides" / "parameters.md"
    options_table(json=False, markdown=True)
    start, end = "<!-- options -->\n", "<!-- end -->\n"
    text = guide.read_text()
    head, tail = text.index(start) + len(start), text.index(end)
    printed = capsys.readouterr().out
    if "GUIDES_WRITE" in os.environ:
        guide.write_text(text[:head] + printed + text[tail:])
    else:
        assert text[head:tail] == printed, "stale: run GUIDES_WRITE=1 python -m pytest tests/test_guides.py"
