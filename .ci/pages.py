"""Build README, the guides and a reference of every public name as pages: ``python .ci/pages.py FOLDER``.

The pages are made in ``FOLDER/pages``, the site in ``FOLDER/site``. A link that leads nowhere, or a
name that is not found, ends the build with an error. ``pip install '.[docs]'``.
"""

import inspect
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ROOMS = {
    "meshflow": "meshflow",
    "meshflow.view": "Pictures",
    "meshflow.synthetic": "Data with a known truth",
    "meshflow.evaluate": "Measures",
    "meshflow.classics": "The systems that the paper cites",
}
SETTINGS = """site_name: meshflow
docs_dir: {pages}
site_dir: {site}
use_directory_urls: false
theme: {{name: mkdocs}}
validation: {{links: {{not_found: warn, anchors: warn, absolute_links: warn}}, nav: {{omitted_files: ignore}}}}
plugins:
  - search
  - mkdocstrings:
      handlers:
        python:
          paths: [{root}]
          options:
            docstring_style: sphinx
            show_root_heading: true
            show_root_full_path: true
            show_source: false
            show_bases: false
            members: false
            heading_level: 2
"""


def written(pages: Path) -> None:
    """The sources of all pages: README, the examples as they are, and one page for each room of public names."""
    shutil.copytree(ROOT / "examples", pages / "examples", ignore=shutil.ignore_patterns("__pycache__", "*.py"))
    (pages / "index.md").write_text((ROOT / "README.md").read_text(encoding="utf-8"), encoding="utf-8")
    (pages / "reference").mkdir()
    for room, title in ROOMS.items():
        lines = [f"# {title}", "", f"What `{room}` has, functions first.", ""]
        module = import_module(room)
        for name in sorted(module.__all__, key=lambda name: (inspect.isclass(getattr(module, name)), name.lower())):
            found = getattr(module, name)
            if inspect.isclass(found) or inspect.isfunction(found):
                lines += [f"::: {found.__module__}.{found.__name__}", ""]
        (pages / "reference" / f"{room}.md").write_text("\n".join(lines), encoding="utf-8")
    with (pages / "index.md").open("a", encoding="utf-8") as index:
        index.write("\n## Reference\n\n" + "".join(f"* [{t}](reference/{r}.md)\n" for r, t in ROOMS.items()))


def main(folder: Path) -> int:
    """Build the site, strictly; the exit code of mkdocs."""
    pages, site = folder / "pages", folder / "site"
    pages.mkdir(parents=True)
    written(pages)
    settings = folder / "mkdocs.yml"
    settings.write_text(SETTINGS.format(pages=pages, site=site, root=ROOT), encoding="utf-8")
    ended = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--config-file", settings], check=False
    )
    print(f"{len(list(site.rglob('*.html')))} pages in {site}")
    return ended.returncode


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve()))
