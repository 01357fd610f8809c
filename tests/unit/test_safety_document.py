"""`docs/safety.md` promises a test for each of its rows: the names must be of tests that there are."""

import re
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
TEXT = (REPOSITORY / "docs" / "safety.md").read_text()
ROWS = [line for line in TEXT.splitlines() if line.startswith("|") and not line.startswith("|---")]


def known_tests() -> set[str]:
    sources = (path.read_text() for path in (REPOSITORY / "tests").rglob("test_*.py"))
    return {name for source in sources for name in re.findall(r"def (test_\w+)", source)}


def test_every_row_names_its_test():
    without = [row for row in ROWS if "`test_" not in row and not row.endswith("| test |")]
    assert not without


@pytest.mark.parametrize("name", sorted(set(re.findall(r"`(test_\w+)`", TEXT))))
def test_what_it_names_exists(name):
    assert name in known_tests()
