"""The page's generated types match the server."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tools import build_page

REPOSITORY = Path(__file__).resolve().parents[2]
TYPES = REPOSITORY / "web" / "src" / "api" / "schema.d.ts"


@pytest.mark.story
def test_the_pages_types_match_the_server(tmp_path: Path) -> None:
    if not (REPOSITORY / "web").is_dir():
        pytest.skip("the page's sources are not in this checkout")
    build_page.install(REPOSITORY)
    new_types = tmp_path / "schema.d.ts"
    command = [str(build_page.node_path() / "node"), "dev/types.mjs", str(new_types)]
    environment = os.environ | {"PYTHON": sys.executable}
    subprocess.run(command, cwd=REPOSITORY / "web", env=environment, check=True, timeout=60)
    for generated, stored in (
        (new_types, TYPES),
        (new_types.with_name("fields.ts"), TYPES.with_name("fields.ts")),
        (new_types.with_name("bounds.ts"), TYPES.with_name("bounds.ts")),
    ):
        assert generated.read_text("utf-8") == stored.read_text("utf-8"), (
            f"{stored.name} does not match the API: run `python -m tools.build_page npm run types`"
        )
