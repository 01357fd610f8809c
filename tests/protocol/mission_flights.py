"""Offboard missions flown by the server's own modules, on simulated time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gcs_server.control.authority import Authority
from gcs_server.control.journal import Journal
from gcs_server.control.lease import LeaseTimes
from gcs_server.control.principal import Principal
from gcs_server.flights.groups import Groups
from gcs_server.flights.mission_flight import MissionFlight
from gcs_server.flights.mission_values import MissionName, Start
from gcs_server.flights.missions import UPDATE_PERIOD_S, OffboardMissions
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.vehicle.vehicle import Vehicle
from missions.offboard import positions
from missions.offboard.compiler import compile_mission
from missions.offboard.document import OffboardMission
from missions.trajectory.limits import MotionLimits
from tests.protocol.offboard_testbed import OffboardTestbed, sleep
from tests.protocol.simulated_testbed import until

ALICE, BOB = (Principal(name.lower(), name, identified=True) for name in ("Alice", "Bob"))
LEASE_S = 5.0


class MissionsTestbed:
    """The offboard missions of vehicle 1, and the control lease of the vehicle.

    Args:
        testbed: a testbed to which no vehicle has been added yet.
        folder: folder of the journal.
    """

    def __init__(self, testbed: OffboardTestbed, folder: Path) -> None:
        self.testbed = testbed
        streams = testbed.streamer._streams
        groups = Groups(testbed.clock, streams, testbed.fleet.events, testbed.streamer.offboard)
        self.offboard = OffboardMissions(testbed.clock, testbed.streamer, streams, groups, testbed.supervisor)
        testbed.fleet.on_vehicle_added(self.offboard.attach)
        journal = Journal(testbed.clock, folder / "journal.jsonl")
        self.authority = Authority(
            testbed.clock, testbed.fleet, journal, testbed.supervisor, LeaseTimes(lease_s=LEASE_S)
        )
        self.authority.start()
        # A lambda, so that a test can replace the method.
        testbed.supervisor.repeat("offboard-missions", lambda: self.offboard.update(), UPDATE_PERIOD_S)
        self.flight: Any = None

    def begin(
        self, vehicle: Vehicle, mission: OffboardMission, *, in_air: bool = False, role: str | None = None
    ) -> MissionFlight:
        """Compiles a mission, or one of its roles, for the vehicle's position, and starts the mission."""
        estimates = VehicleEstimates(vehicle)
        local, attitude = estimates.local(), estimates.attitude()
        assert local is not None
        assert attitude is not None
        start = positions.Start(local.position_ned_m, attitude.yaw_ned_rad, estimates.origin(), in_air=in_air)
        timeline = compile_mission(mission, start=start, role=role)
        name = MissionName(mission.name, None, None)
        part = Start(name, timeline, MotionLimits(speed_m_s=5.0), "Alice", low_battery_share=0.15)
        self.offboard.begin({vehicle.id: part}, {})
        self.flight = self.offboard.flight(vehicle.id)
        return self.flight

    def take_control(self, client: Principal, *, force: bool = False) -> None:
        """Takes control of vehicle 1 for a client."""
        self.authority.control("1").lease.take(client, force=force)

    @property
    def state(self) -> str:
        return self.flight.status().state

    async def reach(self, *states: str, within_s: float = 120.0) -> None:
        """Waits until the mission is in one of these states."""
        await until(lambda: self.state in states, within_s)


def run_in_flight(run_simulated: Any, tmp_path: Path, mission: OffboardMission, scenario: Any) -> None:
    """Runs a test with a scripted vehicle in flight that flies a mission; Alice has control."""

    async def run() -> None:
        testbed = OffboardTestbed()
        missions = MissionsTestbed(testbed, tmp_path)
        link = testbed.link()
        autopilot = testbed.offboard_autopilot(link)
        autopilot.set_hovering()
        try:
            vehicle = await testbed.wait_for_vehicle()
            await sleep(1.5)
            with missions.authority.connected(ALICE):
                missions.take_control(ALICE)
                missions.begin(vehicle, mission, in_air=True)
                await missions.reach("flying", within_s=10)
                await scenario(missions, vehicle, autopilot)
        finally:
            await testbed.close()

    run_simulated(run)


def event_codes(vehicle: Vehicle) -> list[str]:
    """Codes of the events of missions, in order."""
    data_of_events = [event.data or {} for event in vehicle.events.since()]
    return [str(data["code"]) for data in data_of_events if data.get("source") == "offboard_mission"]
