"""Each row of `docs/safety.md` names a test that exists, runs and asserts something."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
TEXT = (REPOSITORY / "docs" / "safety.md").read_text()
ROWS = [line for line in TEXT.splitlines() if line.startswith("|") and not line.startswith("|---")]
NAMED_TESTS = sorted(set(re.findall(r"`(test_\w+)`", TEXT)))
FAILING_CALLS = {"raises", "wait_until", "until", "until_disarmed", "expect", "fail", "to_be_visible"}
"""Calls that can fail a test: functions of pytest and Playwright, and functions that wait for a state."""
SKIP_MARKS = {"skip", "xfail"}
MAX_HELPER_DEPTH = 4

Function = ast.FunctionDef | ast.AsyncFunctionDef


@cache
def functions_by_name() -> dict[str, list[Function]]:
    """Every function of the tests by its name."""
    found: dict[str, list[Function]] = {}
    for path in (REPOSITORY / "tests").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, Function):
                found.setdefault(node.name, []).append(node)
    return found


def name_of(node: ast.AST) -> str:
    """The last part of the name of a called function or a decorator."""
    if isinstance(node, ast.Call):
        node = node.func
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def has_assertion(function: Function, depth: int = 0) -> bool:
    """Whether the function, or a test helper that it calls, has an assertion."""
    nodes = list(ast.walk(function))
    if any(isinstance(node, ast.Assert) for node in nodes):
        return True
    if FAILING_CALLS & {name_of(node) for node in nodes if isinstance(node, ast.Call)}:
        return True
    names = {name_of(node) for node in nodes if isinstance(node, ast.Call | ast.Name | ast.Attribute)}
    helpers = (
        helper for name in names for helper in functions_by_name().get(name, []) if helper is not function
    )
    return depth < MAX_HELPER_DEPTH and any(has_assertion(helper, depth + 1) for helper in helpers)


def test_every_row_of_the_document_names_its_test():
    rows_without_test = [row for row in ROWS if "`test_" not in row and not row.endswith("| test |")]
    assert not rows_without_test


@pytest.mark.parametrize("name", NAMED_TESTS)
def test_each_named_test_exists_runs_and_asserts(name):
    tests = functions_by_name().get(name, [])
    assert len(tests) == 1, f"{len(tests)} tests have this name: a row names exactly one"
    marks = {name_of(mark) for mark in tests[0].decorator_list}
    assert not marks & SKIP_MARKS, "the test is never run"
    assert has_assertion(tests[0]), "the test has no assertion"


def test_a_test_without_an_assertion_is_found():
    without_assertion = ast.parse("def test_idle():\n    sum([1])\n").body[0]
    assert isinstance(without_assertion, ast.FunctionDef)
    assert not has_assertion(without_assertion)
