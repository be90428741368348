"""Settings of Sphinx: the documents as a searchable site, `make site`."""

import re
from pathlib import Path

from sphinx.application import Sphinx

project = "rover_hil"
extensions = ["myst_parser"]
html_theme = "furo"
html_show_sphinx = False
html_copy_source = False
html_show_copyright = False
root_doc = "README"
exclude_patterns = ["site", "generate", "examples"]
myst_heading_anchors = 3
suppress_warnings = ["myst.header"]

FOLDERS = ("tutorials", "how-to", "explanation", "reference", "contributing", "decisions")
PAGES = ("results",)
"""Pages that are in no folder."""
OUTSIDE = re.compile(
    r"\[([^\]]*)\]\((?:\.\./)*(?:CONTRIBUTING\.md|(?:examples|tests|benchmarks|rover_hil)/)[^)]*\)"
)
"""Links to files that are not pages of the site: their text is kept."""


def _read(app: Sphinx, page: str, text: list[str]) -> None:
    text[0] = OUTSIDE.sub(r"\1", text[0])
    if page == root_doc:
        names = "\n".join(PAGES)
        text[0] += f"\n```{{toctree}}\n:hidden:\n\n{names}\n```\n"
        for folder in FOLDERS:
            pages = sorted(path.stem for path in (Path(app.srcdir) / folder).glob("*.md"))
            names = "\n".join(f"{folder}/{name}" for name in pages)
            text[0] += f"\n```{{toctree}}\n:hidden:\n:caption: {folder.capitalize()}\n\n{names}\n```\n"


def setup(app: Sphinx) -> None:
    """Let the contents of the site follow the folders."""
    app.connect("source-read", _read)
