"""Records whether functions are called in the event loop."""

from __future__ import annotations

import asyncio
from typing import Any

from gcs_server.scenarios.simulated_time import SimulatedTimeLoop


def record_calls(monkeypatch: Any, module: Any, name: str) -> list[bool]:
    """Replaces a function of a module by one that also records whether each call is outside the loop."""
    function, outside_loop = getattr(module, name), list[bool]()

    def recorded(*args: Any, **keywords: Any) -> Any:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, SimulatedTimeLoop)
        outside_loop.append(loop.in_executor)
        return function(*args, **keywords)

    monkeypatch.setattr(module, name, recorded)
    return outside_loop
