"""A flight with the messages of PX4 v1.17, converted from the messages of the simulated v1.16."""

from __future__ import annotations

import math
from typing import Any

import pytest

from gcs_server.errors import Refused, Rejected
from gcs_server.vehicle.services.mission_on_vehicle import PlanReference
from missions.formats.mavlink_items import fence_items, mission_items, rally_items
from missions.setpoints import Position
from tests.protocol.offboard_testbed import sleep
from tests.protocol.ros2_testbed import stream_request_for
from tests.protocol.simulated_testbed import SimulatedTestbed, until
from tests.protocol.small_plan import plan_around
from vehicle_sim.mavlink import generated_dialect as sim

FIRMWARE = 0x011100FF
"""v1.17.0 in AUTOPILOT_VERSION."""
REMOVED_PARAMETER = "MPC_HOLD_DZ"
GLOBAL_POSITION = 296
"""A message of v1.17 that the dialect does not know."""
NO_MISSION, NOT_ACTIVE = 1, 2
"""mission_state and mission_mode of MISSION_CURRENT."""
ALTITUDE_CRUISE = 0x000B0000
"""custom_mode of a mode that v1.16 does not have."""


class Px4V117Converter:
    """Converts the messages between the link and a simulated v1.16 vehicle to those of v1.17."""

    def __init__(self, testbed: SimulatedTestbed) -> None:
        self._sim = testbed.sim
        self._parser_from_vehicle, self._parser_to_vehicle = sim.MAVLink(None), sim.MAVLink(None)
        self._packers: dict[tuple[int, int], Any] = {}
        self._replies: list[bytes] = []
        self.in_altitude_cruise = False
        self.announces_cruise = False
        """Whether the list of modes has Altitude Cruise, and the mode can be set."""
        self._v116_frames, self._v116_feed = testbed.sim.frames, testbed.sim.feed
        testbed.sim.frames, testbed.sim.feed = self.frames, self.feed  # type: ignore[method-assign]

    def feed(self, row: int, link: str, data: bytes) -> None:
        """Passes messages to the vehicle, except those that v1.17 refuses."""
        for message in self._parser_to_vehicle.parse_buffer(data) or []:
            name = getattr(message, "param_id", "")
            if name == REMOVED_PARAMETER:
                error = sim.MAVLink_param_error_message(
                    message.get_srcSystem(),
                    message.get_srcComponent(),
                    name.encode(),
                    -1,
                    sim.MAV_PARAM_ERROR_DOES_NOT_EXIST,
                )
                self._replies.append(error.pack(self._packer(1, 1)))
            elif self.announces_cruise and getattr(message, "command", 0) == sim.MAV_CMD_DO_SET_MODE:
                self.in_altitude_cruise = message.param2 == ALTITUDE_CRUISE >> 16
                ack = sim.MAVLink_command_ack_message(message.command, 0, 0, 0, 255, 190)
                self._replies.append(ack.pack(self._packer(1, 1)))
            else:
                self._v116_feed(row, link, bytes(message.get_msgbuf()))

    def frames(self, row: int, link: str) -> list[bytes]:
        """Messages from the vehicle, as v1.17 sends them."""
        replies, self._replies = self._replies, []
        messages = self._parser_from_vehicle.parse_buffer(b"".join(self._v116_frames(row, link))) or []
        return [*replies, *(self._convert(message) for message in messages)]

    def _packer(self, system: int, component: int) -> Any:
        key = system, component
        return self._packers.setdefault(key, sim.MAVLink(None, srcSystem=system, srcComponent=component))

    def _convert(self, message: Any) -> bytes:
        packer = self._packer(message.get_srcSystem(), message.get_srcComponent())
        more_frames = b""
        match message.get_type():
            case "VFR_HUD":
                message.airspeed = math.nan
            case "MISSION_CURRENT" if message.total in (0, 65535):
                message.mission_state, message.mission_mode = NO_MISSION, NOT_ACTIVE
            case "AUTOPILOT_VERSION":
                message.flight_sw_version = FIRMWARE
            case "HEARTBEAT":
                if self.in_altitude_cruise:
                    message.custom_mode = ALTITUDE_CRUISE
                more_frames = self._unknown_frame(packer) + self._integrity_message().pack(packer)
            case "AVAILABLE_MODES" if self.announces_cruise and message.mode_index == 1:
                entry = sim.MAVLink_available_modes_message(26, 8, 0, ALTITUDE_CRUISE, 0, b"Altitude Cruise")
                more_frames = entry.pack(packer)
            case "CURRENT_MODE" if self.in_altitude_cruise:
                message.custom_mode = message.intended_custom_mode = ALTITUDE_CRUISE
        return message.pack(packer) + more_frames

    @staticmethod
    def _unknown_frame(packer: Any) -> bytes:
        """A frame whose checksum the dialect cannot check, because it does not know the message."""
        payload = bytes(range(1, 40))
        header = bytes((0xFD, len(payload), 0, 0, packer.seq, packer.srcSystem, packer.srcComponent))
        packer.seq = (packer.seq + 1) % 256
        return header + GLOBAL_POSITION.to_bytes(3, "little") + payload + b"\x12\x34"

    @staticmethod
    def _integrity_message() -> Any:
        fields = sim.MAVLink_gnss_integrity_message.fieldnames
        return sim.MAVLink_gnss_integrity_message(**dict.fromkeys(fields, 0))


@pytest.mark.story
def test_a_vehicle_with_px4_1_17_is_shown_and_flown_like_a_vehicle_with_1_16(run_simulated: Any) -> None:
    async def scenario() -> None:
        testbed = SimulatedTestbed()
        converter = Px4V117Converter(testbed)
        try:
            vehicle = await testbed.wait_for_vehicle_ready_to_arm()
            await until(lambda: vehicle.identity.firmware == "1.17.0", 5)
            assert vehicle.topic("hud").value.airspeed_m_s is None
            assert vehicle.topic("mission").value.count == 0
            with pytest.raises(Rejected, match="it has no parameter of that name"):
                await vehicle.params.set(REMOVED_PARAMETER, 0.2)
            assert (await vehicle.params.set("MPC_XY_CRUISE", 4.0)).value == 4.0

            await vehicle.command.takeoff(5.0)
            await until(lambda: vehicle.status.mode == "hold", 40)
            await vehicle.offboard.start(stream_request_for(Position((6.0, 0.0, -5.0), yaw_ned_rad=0.0)))
            assert vehicle.status.mode == "offboard"
            await until(lambda: vehicle.topic("local_position").value.position_ned_m[0] > 5.0, 15)
            await vehicle.offboard.stop()
            assert vehicle.status.mode == "hold"

            home = vehicle.topic("home").value
            plan = plan_around(home.lat_deg, home.lon_deg)
            parts = {"mission": mission_items(plan), "fence": fence_items(plan), "rally": rally_items(plan)}
            await vehicle.mission.upload(parts, PlanReference("a", 1, "Out and back"))
            await vehicle.command.start_mission()
            await until(lambda: not vehicle.status.armed, 120)

            converter.in_altitude_cruise = True
            await until(lambda: vehicle.status.mode == "altitude_cruise", 3)
            converter.in_altitude_cruise = False
            await until(lambda: vehicle.status.mode != "altitude_cruise", 3)
            await sleep(1)
            (link,) = (connection.info() for connection in testbed.router.connections())
            assert (link.frames_lost, link.crc_errors, link.bytes_skipped) == (0, 0, 0)
            assert link.frames_unknown > 40
        finally:
            await testbed.close()

    run_simulated(scenario)


@pytest.mark.parametrize("announced", [True, False])
def test_altitude_cruise_is_set_on_a_vehicle_that_announces_it_and_refused_on_others(
    run_simulated: Any, announced: bool
) -> None:
    async def scenario() -> None:
        testbed = SimulatedTestbed()
        converter = Px4V117Converter(testbed)
        converter.announces_cruise = announced
        try:
            vehicle = await testbed.wait_for_vehicle_ready_to_arm()
            if announced:
                await vehicle.command.set_mode("altitude_cruise")
                assert vehicle.status.mode == "altitude_cruise"
            else:
                with pytest.raises(Refused, match="does not announce the mode Altitude cruise"):
                    await vehicle.command.set_mode("altitude_cruise")
                assert vehicle.status.mode == "hold"
        finally:
            await testbed.close()

    run_simulated(scenario)
