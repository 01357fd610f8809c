"""docs/api.md has exactly the calls of the API; `make test-clients` runs its examples."""

from __future__ import annotations

import re
from pathlib import Path

from gcs_server.api.schema import description

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "api.md"
EXAMPLES = re.compile(r"/(vehicles|links)/\w+|/(params)/(?!refresh)\w+")
"""Parts of an address with an example's vehicle, link or parameter."""


def without_variable_names(path: str) -> str:
    """A path whose variables have no names."""
    return re.sub(r"\{\w+(:\w+)?\}", "{}", path)


def calls_of(text: str) -> set[tuple[str, str]]:
    """(method, path) of calls by curl, and of calls named as `GET /path`."""
    shell_examples = "".join(re.findall(r"^```sh\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL))
    found: set[tuple[str, str]] = set()
    for line in re.sub(r"\\\n\s*", "", shell_examples).splitlines():
        if not line.startswith("curl"):
            continue
        method = stated.group(1) if (stated := re.search(r"-X (\w+)", line)) else "GET"
        address = re.search(r"localhost:8080(/api/v1[^\s'?]*)", line)
        assert address, line
        found.add((method, EXAMPLES.sub(lambda m: f"/{m[1] or m[2]}/{{}}", address.group(1))))
    named_calls = re.findall(r"`(GET|POST|PUT|DELETE) (/[^`\s]+)`", text)
    return found | {(method, without_variable_names(f"/api/v1{path}")) for method, path in named_calls}


def test_the_document_has_exactly_the_calls_of_the_api() -> None:
    paths = description()["paths"]
    api_calls = {
        (method.upper(), without_variable_names(path))
        for path, methods in paths.items()
        for method in methods
    }
    assert api_calls == calls_of(DOCUMENT.read_text(encoding="utf-8"))
