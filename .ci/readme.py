"""Print the test command of a README: the code block below the line ``<!-- tests -->``. Without one, fail.

Use: python .ci/readme.py README.md
"""

import re
import sys
from pathlib import Path


def command(text: str) -> str:
    """The lines of the block.

    :raises SystemExit: when the mark, the block or its lines are missing, or there are several marks.
    """
    marks = len(re.findall(r"^<!-- tests -->$", text, re.M))
    if marks != 1:
        raise SystemExit(f"README: one line '<!-- tests -->' expected, got {marks}")
    block = re.search(r"^<!-- tests -->\n+```(?:bash|sh)\n(.*?)^```$", text, re.M | re.S)
    lines = (
        [line for line in block[1].splitlines() if line.strip() and not line.lstrip().startswith("#")] if block else []
    )
    if not lines:
        raise SystemExit("README: a bash block with a test command below '<!-- tests -->' expected, got none")
    return "\n".join(lines)


if __name__ == "__main__":
    print(command(Path(sys.argv[1]).read_text(encoding="utf-8")))
