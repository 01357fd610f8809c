"""`docs/architecture.md` answers questions of new developers, each with a file that exists."""

import re
import tomllib
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
TEXT = (REPOSITORY / "docs" / "architecture.md").read_text(encoding="utf-8")
QUESTIONS = TEXT.partition("## Questions")[2].partition("\n## ")[0]
ROWS = [line.strip("| ").split(" | ") for line in QUESTIONS.splitlines() if line.startswith("| ")][1:]
ROOTS = ("gcs_server", "missions", "vehicle_sim", "web/src", "tests", "tools")
FILE = re.compile(r"\w[\w./-]*\.(?:py|ts|svelte|txt)\b")


def test_the_document_answers_at_least_twenty_questions() -> None:
    assert len(ROWS) >= 20
    assert len({row[0] for row in ROWS}) == len(ROWS)


@pytest.mark.parametrize("row", ROWS, ids=[row[0] for row in ROWS])
def test_an_answer_begins_with_one_file_that_exists(row: list[str]) -> None:
    question, answer = row
    assert question.endswith("?")
    first_file = FILE.match(answer.removeprefix("`"))
    assert first_file is not None
    assert (REPOSITORY / first_file[0]).is_file()


def test_every_file_named_in_the_document_exists() -> None:
    existing = [f"/{path.as_posix()}" for root in ROOTS for path in (REPOSITORY / root).rglob("*.*")]
    missing = {name for name in FILE.findall(TEXT) if not any(path.endswith(f"/{name}") for path in existing)}
    assert not missing


def test_every_folder_named_in_the_document_exists() -> None:
    existing = [
        f"/{path.relative_to(REPOSITORY).as_posix()}/"
        for root in ROOTS
        for path in (REPOSITORY / root).rglob("*")
        if path.is_dir()
    ]
    existing += [f"/{root}/" for root in ROOTS]
    named = set(re.findall(r"`(\w[\w/]*/)`", TEXT))
    assert len(named) > 30
    assert not {name for name in named if not any(path.endswith(f"/{name}") for path in existing)}


def test_the_packages_of_the_server_are_those_of_the_import_contract() -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = project["tool"]["importlinter"]["contracts"]
    (layers,) = (each["layers"] for each in contracts if each.get("layers", [""])[0] == "gcs_server.cli")
    (drawn,) = re.findall(r"^gcs_server +(cli .+)$", TEXT, re.MULTILINE)
    assert drawn.split(" ─► ") == [
        re.sub(r"gcs_server\.", "", layer).replace(" | ", ", ") for layer in layers
    ]
