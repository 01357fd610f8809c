"""The documents: their links lead somewhere, what they name of page and simulator exists."""

import re
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest
import yaml

from tools import compat
from vehicle_sim.script import load_script

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")])
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
CODE = re.compile(r"^ *```.*?^ *```", re.MULTILINE | re.DOTALL)
IMPORT = re.compile(r"^\s*import (?:type )?\{ ([\w, ]+) \} from '(\.\.?/[^']+)';$", re.MULTILINE)
PATH = re.compile(r"`((?:docs|gcs_server|missions|tests|tools|vehicle_sim|web)/[\w./-]+)`")
PAGE = ROOT / "web" / "src"


@cache
def text_of(path: Path) -> str:
    """A document without its blocks of code, in which a bracket is no link."""
    return CODE.sub("", path.read_text(encoding="utf-8"))


def anchors(path: Path) -> set[str]:
    """The anchors of the document's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.+)$", text_of(path), re.MULTILINE)
    plain = (re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower() for heading in headings)
    return {re.sub(r"[^\w\- ]", "", heading).replace(" ", "-") for heading in plain}


def blocks(document: str, language: str) -> list[str]:
    """The blocks of code of a language."""
    text = (ROOT / "docs" / document).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_link_leads_to_a_file_and_a_heading(document: Path) -> None:
    broken = []
    for target in LINK.findall(text_of(document)):
        if re.match(r"[a-z]+:", target):
            continue
        name, _, anchor = target.partition("#")
        path = (document.parent / name).resolve() if name else document
        if not path.exists() or (anchor and anchor not in anchors(path)):
            broken.append(target)
    assert not broken


def test_the_index_names_every_document() -> None:
    named = set(LINK.findall(text_of(ROOT / "docs" / "README.md")))
    missing = {path.name for path in (ROOT / "docs").glob("*.md")} - {name.split("#")[0] for name in named}
    assert missing <= {"README.md"}


def test_the_changelog_begins_with_the_version_of_the_package() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    (newest, *_) = re.findall(r"^## (\S+)", text_of(ROOT / "CHANGELOG.md"), re.MULTILINE)
    assert newest == project["version"]


def test_every_path_that_a_document_names_exists() -> None:
    missing = [
        f"{document.name}: {path}"
        for document in DOCUMENTS
        if not document.name.startswith("how-to-add")  # they name the files that a reader makes
        for path in PATH.findall(text_of(document))
        if not (ROOT / path).exists()
    ]
    assert not missing


def test_the_buttons_of_the_tutorial_exist_on_the_page() -> None:
    text = text_of(ROOT / "docs" / "tutorial.md")
    buttons = {button.removesuffix("…") for button in re.findall(r"\*\*([^*]+)\*\*", text)} - {"bold"}
    assert len(buttons) >= 15
    sources = "\n".join(
        path.read_text(encoding="utf-8") for path in PAGE.rglob("*") if path.suffix in {".ts", ".svelte"}
    )
    assert not {button for button in buttons if button not in sources}


def test_the_imports_of_the_page_card_exist() -> None:
    imports = [
        found for snippet in ("ts", "svelte") for block in blocks("how-to-add-a-page-card.md", snippet)
        for found in IMPORT.findall(block)
    ]  # fmt: skip
    assert len(imports) >= 4
    for names, module in imports:
        if module.startswith("./"):
            continue
        path = (PAGE / "features" / "track" / module).resolve()
        source = next(file for file in (path, path.with_suffix(".ts"), Path(f"{path}.ts")) if file.is_file())
        for name in names.split(", "):
            assert re.search(rf"export (const|function|interface|class|type) {name}\b", source.read_text())


def test_the_fault_script_of_the_document_is_valid(tmp_path: Path) -> None:
    (script,) = blocks("how-to-write-a-fault-script.md", "yaml")
    file = tmp_path / "faults.yaml"
    file.write_text(script, encoding="utf-8")
    assert len(load_script(str(file)).events) == len(yaml.safe_load(script)["events"])


def test_the_table_of_compatibility_is_the_one_that_make_compat_prints() -> None:
    assert compat.table() in (ROOT / "docs/compatibility.md").read_text(encoding="utf-8")
    assert {compat.installed(row) for row in compat.ROWS if row.name in ("Python", "pymavlink")} == {
        ".".join(map(str, sys.version_info[:3])),
        "2.4.50",
    }
