"""Prints how many lines of code the product has, by folder, and its longest functions.

`python -m tools.code_size`. A line of code is neither blank nor, as a whole, a comment or part of a
docstring. Tests (`tests/`, `*.test.ts`), generated files and what Git does not track do not count.
`python -m tools.code_size --check` fails if a Python function has more than 60 lines.
"""

from __future__ import annotations

import ast
import io
import re
import subprocess
import sys
import tokenize
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent
LONGEST_FUNCTION = 60
"""Lines of code of a function, its signature included, its docstring not."""
NOT_COUNTED = re.compile(r"^tests/|\.test\.ts$|/testing/|schema\.d\.ts$|_dialect\.py$|^web/dev/mock/")
COMMENTS = re.compile(r"<!--.*?-->|/\*.*?\*/|^\s*//.*?$", re.DOTALL | re.MULTILINE)
LAYOUT = {
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENCODING,
    tokenize.COMMENT,
}
GENERATED = ("# Generated", "// Generated", '"""Generated')


def counted_files() -> list[Path]:
    """The product's source files that Git tracks, relative to the repository."""
    listed = subprocess.check_output(["git", "ls-files"], cwd=REPOSITORY, text=True)
    names = [name for name in listed.splitlines() if name.endswith((".py", ".ts", ".svelte", ".css"))]
    return [Path(name) for name in names if not NOT_COUNTED.search(name) and (REPOSITORY / name).exists()]


def python_lines(source: str) -> set[int]:
    """Numbers of the lines of `source` with code."""
    lines: set[int] = set()
    statement_starts = True
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type in LAYOUT:
            statement_starts |= token.type in {tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT}
            continue
        if not (token.type == tokenize.STRING and statement_starts):
            lines.update(range(token.start[0], token.end[0] + 1))
        statement_starts = False
    return lines


def functions(path: Path, source: str, code: set[int]) -> Iterator[tuple[int, str]]:
    """Lines of code and place of each function of a file."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            size = len(code.intersection(range(node.lineno, (node.end_lineno or node.lineno) + 1)))
            yield size, f"{path}:{node.lineno} {node.name}"


def main(arguments: list[str]) -> int:
    """Prints the table, or with `--check` only the functions that are too long."""
    lines: dict[str, int] = defaultdict(int)
    files: dict[str, int] = defaultdict(int)
    found: list[tuple[int, str]] = []
    for path in counted_files():
        source = (REPOSITORY / path).read_text(encoding="utf-8")
        if source.startswith(GENERATED):
            continue
        if path.suffix == ".py":
            code = python_lines(source)
            found.extend(functions(path, source, code))
            size = len(code)
        else:
            size = sum(1 for line in COMMENTS.sub("", source).splitlines() if line.strip())
        lines[path.parts[0]] += size
        files[path.parts[0]] += 1
    found.sort(reverse=True)
    too_long = [entry for entry in found if entry[0] > LONGEST_FUNCTION]
    if arguments == ["--check"]:
        for size, place in too_long:
            print(f"{place}: {size} lines of code, at most {LONGEST_FUNCTION}")
        return bool(too_long)
    for folder in sorted(lines):
        print(f"{folder:12} {lines[folder]:7,} lines {files[folder]:5} files")
    print(f"{'all':12} {sum(lines.values()):7,} lines {sum(files.values()):5} files")
    print(f"\n{len(too_long)} functions above {LONGEST_FUNCTION} lines; the longest:")
    print("\n".join(f"{size:5} {place}" for size, place in found[:10]))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
