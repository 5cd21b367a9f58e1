"""Run the Python and shell blocks of a Markdown page, in order, in one namespace and one folder.

Lines of shell that start with ``meshflow`` run in this process, because each process of its own takes a second to start; a
refusal is an exception. All others are given to bash.
"""

import glob
import shlex
import subprocess
import sys
from pathlib import Path

from sybil import Example, Sybil
from sybil.parsers.markdown import CodeBlockParser, PythonCodeBlockParser, SkipParser
from typer.main import get_command

from meshflow.cli.commands import app

ROOT = Path(__file__).parents[2]
GUIDES = sorted((ROOT / "examples" / "guides").glob("*.md"))
PAGES = [ROOT / "README.md", *GUIDES]


def words(line):
    """The words of a line as a shell would pass them on: comments gone, patterns replaced by the files that match."""
    found = []
    for word in shlex.split(line, comments=True):
        found += sorted(glob.glob(word)) or [word] if set(word) & set("*?[") else [word]
    return found


def lines(text):
    """The commands of a block: a backslash at the end of a line joins it to the next."""
    return [line.strip() for line in text.replace("\\\n", " ").splitlines() if line.strip() and line.strip()[0] != "#"]


def shell(example: Example):
    for line in lines(example.parsed):
        if line.startswith("meshflow ") and not set(line.split("#")[0]) & set("|&;><$"):
            get_command(app).main(words(line)[1:], prog_name="meshflow", standalone_mode=False)
        else:
            command = f'meshflow() {{ "{sys.executable}" -m meshflow "$@"; }}; {line}'
            subprocess.run(["bash", "-ec", command], check=True)


PARSERS = [PythonCodeBlockParser(), CodeBlockParser(language="bash", evaluator=shell), SkipParser()]


def run(page: Path) -> None:
    """Evaluate the blocks of ``page`` in the present folder."""
    for example in Sybil(parsers=PARSERS).parse(page).examples():
        example.evaluate()
