"""One scripted vehicle on a link that may lose packets."""

import struct

from gcs_server.vehicle.px4.events import ARMING_SUMMARY_ID, HEALTH_SUMMARY_ID
from gcs_server.vehicle.px4.modes import BY_NAME
from tests.protocol.memory_testbed import MemoryTestbed

HOLD_MODE_BIT = 1 << BY_NAME["hold"].nav_state
"""Bit mask of Hold mode in an arming report."""
PACKET_LOSS_CASES = [(0.0, 1), (0.05, 2), (0.2, 3), (0.2, 4), (0.2, 6)]
"""The share of packets lost in each direction, and the seed of the losses."""


def run_scenario(run_simulated, scenario, *, loss=0.0, seed=0):
    """Runs a scenario with the testbed, the server's vehicle and its scripted autopilot."""

    async def run():
        testbed = MemoryTestbed()
        link = testbed.link()
        autopilot = testbed.autopilot(link, loss=loss, seed=seed)
        try:
            vehicle = await testbed.wait_for_vehicle()
            await scenario(testbed, vehicle, autopilot)
        finally:
            await testbed.close()

    run_simulated(run)


def send_arming_report(autopilot, can_arm, present=1):
    """Sends the two events of an arming report.

    Args:
        autopilot: the scripted autopilot.
        can_arm: bit mask of the modes in which the vehicle can be armed.
        present: bit mask of the health components that are present.
    """
    autopilot.send_event(ARMING_SUMMARY_ID, 0x88, struct.pack("<BIIII", 0, 0, 0, can_arm, can_arm))
    autopilot.send_event(HEALTH_SUMMARY_ID, 0x88, struct.pack("<BIII", 0, present, 0, 0))
