"""A simulated PX4 with factory settings, whose parameters and metadata the server has read."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from types import SimpleNamespace
from typing import Any

from gcs_server.vehicle import metadata_files
from gcs_server.vehicle.param_review import WantedParam
from gcs_server.vehicle.services.gimbal_setup import GimbalSetupService
from gcs_server.vehicle.services.param_changes import ParamChange, ParamChanges
from tests.protocol.offboard_testbed import OffboardTestbed
from tests.protocol.simulated_autopilot import SimulatedAutopilot

FACTORY = {"MNT_MODE_IN": -1}
Scenario = Callable[[Any], Awaitable[None]]


def run_with_vehicle(run_simulated: Any, scenario: Scenario, *, loss: float = 0.0, seed: int = 0) -> None:
    """Runs a test with a simulated PX4 with factory settings, whose parameters have been read."""

    async def run() -> None:
        testbed = OffboardTestbed()
        autopilot = SimulatedAutopilot(testbed.link(), seed=seed, parameters=FACTORY)
        try:
            vehicle = await testbed.wait_for_vehicle()
            await asyncio.sleep(1.0)
            vehicle.metadata.read = _read_here
            vehicle.metadata.run_in_thread = _run_here
            await vehicle.params.refresh()
            autopilot.loss = loss
            rig = SimpleNamespace(testbed=testbed, autopilot=autopilot, vehicle=vehicle)
            rig.changes, rig.setup = vehicle.service(ParamChanges), vehicle.service(GimbalSetupService)
            await scenario(rig)
        finally:
            autopilot.alive = False
            await testbed.close()

    run_simulated(run)


async def _read_here(kind: int, packed: bytes, crc: int) -> Any:
    return metadata_files.decode_document(kind, metadata_files.encode_document(kind, packed, crc))


async def _run_here(work: Callable[[], Any]) -> Any:
    return work()


async def apply_values(rig: Any, values: dict[str, float], **options: Any) -> Any:
    """Reviews values and writes them."""
    rows = await rig.changes.review([WantedParam(*each) for each in values.items()])
    return await rig.changes.apply([ParamChange(r.name, r.old, r.new) for r in rows], **options)
