"""Runs all checks except the Python tests, two at a time: style, imports, types, and the page's checks.

`python -m tools.checks` runs all groups, `python -m tools.checks lint` only the group `lint`. A check that
passes prints its time, a check that fails prints its whole output. Checks run at a low priority, so that they
do not slow down tests that run at the same time.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

from tools import build_page

REPOSITORY = Path(__file__).resolve().parent.parent
PARALLEL_CHECKS = 2
PRIORITY = 5
"""Added to the niceness of the checks: at 10, the page's tests starved, and their processes lost touch."""


@dataclass(frozen=True, slots=True)
class Check:
    """A command that fails if it finds a problem."""

    name: str
    command: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of a check."""

    check: Check
    passed: bool
    output: str
    duration_s: float


def _tool(name: str, tool: str, *arguments: str) -> Check:
    """A check by a tool of this Python environment."""
    return Check(name, (str(Path(sys.executable).parent / tool), *arguments))


def _page(script: str) -> Check:
    """A check by a script of the page's package.json."""
    command = (sys.executable, "-m", "tools.build_page", "npm", "run", "--silent", script)
    return Check(f"page {script}", command)


STYLE = (
    _page("lint:code"),
    _page("lint:format"),
    _tool("imports", "lint-imports"),
    _tool("format", "ruff", "format", "--check", "."),
    _tool("style", "ruff", "check", "."),
    Check("size", (sys.executable, "-m", "tools.code_size", "--check")),
)
LINT = (_tool("types", "pyright"), _page("check:types"), *STYLE)
"""The longest check is first, so that the second processor runs all others meanwhile."""
PAGE = (_page("check:svelte"), _page("test"))
"""svelte-check also finds type errors in TypeScript."""
GROUPS = {"lint": LINT, "page": PAGE, "style": STYLE}
ALL = ("lint", "page")


def run(check: Check) -> Outcome:
    """Runs one check from the repository's folder."""
    began_s = time.monotonic()
    process = subprocess.run(
        check.command,
        cwd=REPOSITORY,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        errors="replace",
        check=False,
    )
    return Outcome(check, process.returncode == 0, process.stdout, time.monotonic() - began_s)


def run_all(checks: Iterable[Check]) -> bool:
    """Runs checks `PARALLEL_CHECKS` at a time and prints each result; returns whether all passed."""
    with ThreadPoolExecutor(PARALLEL_CHECKS) as pool:
        outcomes = [pool.submit(run, check) for check in checks]
        passed = True
        for future in as_completed(outcomes):
            outcome = future.result()
            passed &= outcome.passed
            if not outcome.passed:
                print(f"--- {outcome.check.name} failed:\n{outcome.output.rstrip()}\n---")
            print(f"{outcome.check.name}: {'ok' if outcome.passed else 'FAILED'}, {outcome.duration_s:.0f} s")
            sys.stdout.flush()
    return passed


def main(names: Sequence[str]) -> int:
    """Runs the named groups, or all checks without a name."""
    unknown = set(names) - GROUPS.keys()
    if unknown:
        print(
            f"Unknown group: {', '.join(sorted(unknown))}. Choose from {', '.join(GROUPS)}.", file=sys.stderr
        )
        return 2
    os.nice(PRIORITY)
    build_page.install(REPOSITORY)  # once, before two checks need it
    return 0 if run_all(check for name in names or ALL for check in GROUPS[name]) else 1


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
