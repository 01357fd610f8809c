"""The server's routes for missions as flight modes, and another ground station, on simulated time."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

from gcs_server.api import offboard_mission_models, offboard_mission_routes
from gcs_server.control.principal import Principal
from gcs_server.errors import Refused
from tests.protocol.api_calls import ANNA, InlinePlanWork, json_of, new_station
from tests.protocol.offboard_testbed import sleep
from tests.protocol.ros2_testbed import Ros2Testbed
from tests.protocol.simulated_testbed import until
from tests.support.line_mission import MISSION, MODE_NAME
from vehicle_sim.mavlink import generated_dialect as sim
from vehicle_sim.px4_version import DEFAULT, Px4Version

DEFERRAL_S = 6
"""How long a mission mode defers failsafes."""
LONG_HOLD_MISSION: dict[str, Any] = {**MISSION, "steps": [{"step": "hold", "duration_s": 60}]}
"""A mission that holds for a minute."""


class OtherStation:
    """Another ground station, which commands the vehicle over its own MAVLink link."""

    def __init__(self, testbed: Ros2Testbed) -> None:
        self._sim = testbed.sim
        self._pack = sim.MAVLink(None, srcSystem=254, srcComponent=190)

    def command(self, command: int, *params: float) -> None:
        seven_params = (*params, *(0.0,) * (7 - len(params)))
        message = sim.MAVLink_command_long_message(1, 1, command, 0, *seven_params)
        self._sim.feed(0, "gcs", message.pack(self._pack))

    async def send_heartbeats(self, duration_s: float) -> None:
        """Sends the heartbeats of a ground station; when they end, PX4 detects a lost connection."""
        heartbeat = sim.MAVLink_heartbeat_message(sim.MAV_TYPE_GCS, sim.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)
        for _ in range(round(duration_s)):
            self._sim.feed(0, "gcs", heartbeat.pack(self._pack))
            await sleep(1.0)

    def select_mode(self, mode: str) -> None:
        number = int(mode.removeprefix("external_"))
        self.command(sim.MAV_CMD_DO_SET_MODE, 1, 4, 10 + number)

    async def selectable_modes(self) -> list[str]:
        """Names of the modes that can be selected, from AVAILABLE_MODES."""
        self._sim.drain(0, "gcs")
        self.command(sim.MAV_CMD_REQUEST_MESSAGE, sim.MAVLINK_MSG_ID_AVAILABLE_MODES, 0)
        await sleep(1.0)
        messages = sim.MAVLink(None).parse_buffer(self._sim.drain(0, "gcs")) or []
        modes = [m for m in messages if m.get_type() == "AVAILABLE_MODES"]
        return [m.mode_name for m in modes if not m.properties & sim.MAV_MODE_PROPERTY_NOT_USER_SELECTABLE]


class MissionModesTestbed:
    """The server's routes for vehicle 1, which is connected over ROS 2."""

    def __init__(self, testbed: Ros2Testbed, vehicle: Any) -> None:
        self.testbed, self.vehicle, self.other_station = testbed, vehicle, OtherStation(testbed)
        self.station = new_station(testbed)
        self.station.flights.plan_work = InlinePlanWork()
        self.station.flights.missions.attach(vehicle)
        self.station.flights.missions.start()
        self.station.flights.mission_modes.start()
        self.station.authority.start()

    async def register(self, *, by: Principal = ANNA, **body: Any) -> dict[str, Any]:
        request = offboard_mission_models.RegisterMode.model_validate(
            {"mission": MISSION, "name": MODE_NAME, **body}
        )
        return json_of(await offboard_mission_routes.register("1", request, self.station, by))["modes"][-1]

    async def unregister(self, name: str = MODE_NAME, *, by: Principal = ANNA) -> list[dict[str, Any]]:
        request = offboard_mission_models.UnregisterMode(name=name)
        return json_of(await offboard_mission_routes.unregister("1", request, self.station, by))["modes"]

    async def list_modes(self) -> dict[str, Any]:
        return json_of(await offboard_mission_routes.show_modes(self.vehicle, self.station))

    @property
    def mission_state(self) -> str | None:
        """State of the vehicle's mission; None: no mission."""
        status = self.station.flights.missions.status("1")
        return None if status is None else status.state

    def warning_texts(self) -> list[str]:
        return [event.text for event in self.vehicle.events.since() if event.kind == "warning"]

    def event_texts(self) -> str:
        return "\n".join(event.text for event in self.vehicle.events.since())

    def sent_messages(self, topic: str) -> list[bytes]:
        return [data for name, data in self.testbed.topics[0].sent_messages if name == topic]

    def north_m(self) -> float:
        return self.vehicle.topic("local_position").value.position_ned_m[0]

    async def until_mode(self, mode: str, timeout_s: float = 5.0) -> None:
        """Waits until the server reports this mode of the vehicle."""
        await until(lambda: self.vehicle.status.mode == mode, timeout_s)

    async def start_in_flight(self) -> str:
        """Registers the mission as a mode, selects the mode from the other station in flight, and waits until
        the vehicle moves; returns the mode."""
        mode = (await self.register())["mode"]
        self.other_station.select_mode(mode)
        await self.until_mode(mode)
        start_north_m = self.north_m()
        await until(lambda: self.north_m() > start_north_m + 2, 15)
        return mode


Scenario = Callable[[MissionModesTestbed], Awaitable[None]]


def run_with_mission_modes(
    run_simulated: Any, scenario: Scenario, *, in_air: bool = True, px4: Px4Version = DEFAULT
) -> None:
    """Runs a test with a simulated vehicle whose MAVLink link is connected only to the other station."""

    async def run() -> None:
        testbed = Ros2Testbed(mavlink=True, px4=px4)
        testbed.mavlink_on = False
        try:
            vehicle = await (testbed.take_off() if in_air else testbed.wait_for_vehicle_ready_to_arm())
            await scenario(MissionModesTestbed(testbed, vehicle))
        finally:
            await testbed.close()

    run_simulated(run)


class UnavailablePlanWork:
    """Refuses all work, so that no mission can be compiled."""

    async def run(self, *_: Any, **__: Any) -> Any:
        raise Refused("No worker.", remedy="Try later.")


class SlowPlanWork(InlinePlanWork):
    """Executes the tasks as a slow machine does.

    Args:
        takes_s: time that each task takes.
    """

    def __init__(self, takes_s: float) -> None:
        self._takes_s = takes_s

    async def run(self, task: Any, arguments: Any, **options: Any) -> Any:
        await sleep(self._takes_s)
        return await super().run(task, arguments, **options)
