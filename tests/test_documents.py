"""Links between documents, and paths of documents in the code, lead somewhere."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
DOCUMENTS = [*ROOT.glob("*.md"), *DOCS.rglob("*.md")]
CODE = ("drivers", "controllers", "sim_backends", "rover_hil", "benchmarks", "tests")
KINDS = ("tutorials", "how-to", "explanation", "reference", "results", "decisions")


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def anchors_of(page: Path) -> set[str]:
    """Return the anchors that a Markdown viewer makes of the headings."""
    headings = re.findall(r"^#+ (.*)$", page.read_text("utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", DOCUMENTS, ids=name_of)
def test_every_link_leads_to_a_file_and_a_heading(page: Path) -> None:
    broken = []
    for link, _, anchor in re.findall(r"\]\((?!https?:)([^)#\s]*)(#([^)\s]*))?\)", page.read_text("utf-8")):
        target = (page.parent / link) if link else page
        if not target.exists() or (anchor and anchor not in anchors_of(target)):
            broken.append(f"{link}#{anchor}")
    assert broken == []


def test_every_document_that_the_code_names_exists() -> None:
    files = [ROOT / "Makefile", *DOCUMENTS]
    files += [
        path for folder in CODE for path in (ROOT / folder).rglob("*.*") if path.suffix in (".py", ".toml")
    ]
    texts = [path.read_text("utf-8") for path in files]
    names = {name for text in texts for name in re.findall(r"docs/[\w/-]+\.(?:md|jpg|png)", text)}
    assert len(names) > 20
    assert sorted(name for name in names if not (ROOT / name).is_file()) == []


def test_every_page_is_of_one_kind() -> None:
    assert {path.parent.name for path in DOCS.rglob("*.md")} <= {*KINDS, "docs"}
