"""Links between documents, paths of documents in the code, and code that the guide names exist."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
DOCUMENTS = [*ROOT.glob("*.md"), *DOCS.rglob("*.md"), *(ROOT / "benchmarks").rglob("*.md")]
CODE = ("drivers", "controllers", "sim_backends", "rover_hil", "benchmarks", "tests")
BASES = ("", "docs", "rover_hil")
"""Folders from which the contributor guide names paths."""
KINDS = ("tutorials", "how-to", "explanation", "reference", "contributing", "decisions")


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
    names = {
        name
        for text in texts
        for name in re.findall(r"(?:docs|benchmarks)/[\w/-]+\.(?:md|jpg|png|csv)", text)
    }
    assert len(names) > 20
    assert sorted(name for name in names if not (ROOT / name).is_file()) == []


def test_every_benchmark_that_is_named_can_be_run() -> None:
    files = [path for path in ROOT.rglob("*.*") if path.suffix in (".md", ".py", ".toml")]
    files = [
        path for path in files if path.relative_to(ROOT).parts[0] in (*CODE, "docs") or path in DOCUMENTS
    ]
    names = {
        name
        for path in files
        for name in re.findall(r"python -m benchmarks\.([\w.]*\w)", path.read_text("utf-8"))
    }
    assert len(names) > 30
    modules = {name: ROOT / "benchmarks" / name.replace(".", "/") for name in names}
    missing = [
        name
        for name, path in modules.items()
        if not (path.with_suffix(".py").is_file() or (path / "__main__.py").is_file())
    ]
    assert sorted(missing) == []


def test_every_page_is_of_one_kind() -> None:
    assert {path.parent.name for path in DOCS.rglob("*.md")} <= {*KINDS, "docs"}


@pytest.mark.parametrize("folder", [DOCS, DOCS / "decisions"], ids=name_of)
def test_the_index_lists_every_page_once(folder: Path) -> None:
    index = folder / "README.md"
    links = re.findall(r"\]\(([^)]+\.md)\)", index.read_text("utf-8"))
    own = [page for page in folder.rglob("*.md") if page != index]
    expected = [
        page for page in own if folder != DOCS or page.parent.name != "decisions" or page.stem == "README"
    ]
    assert sorted((folder / link).resolve() for link in links) == sorted(expected)


def test_the_contributor_guide_names_files_and_names_that_exist() -> None:
    words = re.findall(r"`([\w./-]+)`", (ROOT / "CONTRIBUTING.md").read_text("utf-8"))
    paths = [word for word in words if "/" in word and word[0] not in "/."]
    assert len(paths) > 50
    assert [path for path in paths if not any((ROOT / base / path).exists() for base in BASES)] == []
    code = "\n".join(path.read_text("utf-8") for folder in CODE for path in (ROOT / folder).rglob("*.py"))
    known = set(re.findall(r"\w+", code))  # a search for each name in all of it takes ten seconds
    names = {word for word in words if re.fullmatch(r"_?[A-Z]\w*|_\w+|\w+\(\)|\w+_\w+", word)}
    assert len(names) > 15
    assert sorted(name for name in names if name.removesuffix("()") not in known) == []


def test_the_tests_that_prove_what_deleted_ones_proved_exist() -> None:
    page = (ROOT / "docs/contributing/tests.md").read_text("utf-8")
    named = set(re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", page))
    assert len(named) > 30
    missing = [
        f"{file}::{name}"
        for file, name in sorted(named)
        if not re.search(rf"^def {name}\(", (ROOT / file).read_text("utf-8"), re.MULTILINE)
    ]
    assert missing == []
