"""A vehicle that flies Offboard as in the recordings of PX4, and all setpoint streams, on simulated time.

The scheduler of the streams runs in the event loop instead of its process, so that a flight is repeatable;
`tests/integration/gcs_server/streamer/process/` tests the process.
"""

from __future__ import annotations

import asyncio
import itertools
from typing import Any

from gcs_server.scenarios.in_loop_scheduler import InLoopScheduler
from gcs_server.streamer.offboard.streamer import SNAPSHOT_PERIOD_S, Streamer
from gcs_server.streamer.values.stream_request import OnExpiry, StreamRequest
from missions.setpoints import Position, Velocity
from tests.protocol.fake_autopilot import (
    COMMANDER_DELAY_S,
    IN_AIR,
    INT32,
    OFFBOARD_MODE,
    ON_GROUND,
    POSITION_MODE,
    REAL32,
    FakeAutopilot,
)
from tests.protocol.memory_testbed import MemoryTestbed
from vehicle_sim.mavlink import generated_dialect as sim

STEP_S = 0.004
OFFBOARD_LOSS_S = 1.0


class OffboardAutopilot(FakeAutopilot):
    """Accepts Offboard only with a stream, and switches to Position by failsafe a second after the last
    setpoint. After disarming it reports Offboard again, because Offboard is still the requested mode."""

    def __init__(self, link: Any, **options: Any) -> None:
        super().__init__(link, **options)
        self.params |= {"COM_OF_LOSS_T": (REAL32, OFFBOARD_LOSS_S), "COM_OBL_RC_ACT": (INT32, 0)}
        self.setpoints: list[tuple[float, Any]] = []
        self.attitude_and_global_setpoints: list[tuple[float, Any]] = []
        """Setpoints of attitude, rates or global position."""
        self.position_ned_m = [0.0, 0.0, 0.0]
        self.velocity = (0.0, 0.0, 0.0)
        self.has_estimates = True
        self.offboard_delay_s = COMMANDER_DELAY_S
        self.requested_mode = self.mode
        self.failsafe_count = 0
        self.next_mode_s = 0.0
        self._every(0.03, self.send_local_position)
        self._every(0.05, self.send_attitude)
        self._every(1.0, self.send_estimator_status)
        self._every(0.05, self.check_stream)

    def send_local_position(self) -> None:
        if self.has_estimates:
            self.send(
                sim.MAVLink_local_position_ned_message(self.boot_ms(), *self.position_ned_m, *self.velocity)
            )

    def send_estimator_status(self) -> None:
        if self.has_estimates:
            self.send(sim.MAVLink_estimator_status_message(0, 895, 0, 0, 0, 0, 0, 0, 0.1, 0.1))

    def send_attitude(self) -> None:
        self.send(sim.MAVLink_attitude_message(self.boot_ms(), 0, 0, 0.5, 0, 0, 0))

    def set_hovering(self) -> None:
        """Sets the state of a vehicle that hovers in Hold, 5 m above its local origin."""
        self.armed, self.landed_state, self.position_ned_m = True, IN_AIR, [0.0, 0.0, -5.0]

    def handle(self, message: Any) -> None:
        if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
            self.setpoints.append((self.loop.time(), message))
        if message.get_type() in ("SET_POSITION_TARGET_GLOBAL_INT", "SET_ATTITUDE_TARGET"):
            self.attitude_and_global_setpoints.append((self.loop.time(), message))
        super().handle(message)

    def has_stream(self) -> bool:
        last_times_s = [
            targets[-1][0] for targets in (self.setpoints, self.attitude_and_global_setpoints) if targets
        ]
        return bool(last_times_s) and self.loop.time() - max(last_times_s) <= OFFBOARD_LOSS_S

    def set_mode(self, params: list[float]) -> None:
        mode = int(params[1]) << 16 | int(params[2]) << 24
        self.send_ack(sim.MAV_CMD_DO_SET_MODE, 0)
        delay_s = self.offboard_delay_s if mode == OFFBOARD_MODE else COMMANDER_DELAY_S
        # Replies keep their order.
        self.next_mode_s = max(self.loop.time() + delay_s, self.next_mode_s + 0.001)

        def reply_of_commander() -> None:
            if mode != OFFBOARD_MODE:
                self.mode = self.requested_mode = mode
                self.send_ack(sim.MAV_CMD_DO_SET_MODE, 0)
                self.send_current_mode()
            elif not self.armed or self.has_stream():
                self.mode = self.requested_mode = OFFBOARD_MODE
                self.send_ack(sim.MAV_CMD_DO_SET_MODE, 0)
                self.send_current_mode()
            else:
                self.send_ack(sim.MAV_CMD_DO_SET_MODE, 1)

        self.loop.call_at(self.next_mode_s, reply_of_commander)

    def check_stream(self) -> None:
        """The failsafe: Position mode after the last setpoint has timed out."""
        if self.armed and self.mode == OFFBOARD_MODE and not self.has_stream():
            self.mode = POSITION_MODE
            self.failsafe_count += 1
            self.send_current_mode()

    def land_and_disarm(self) -> None:
        """Lands and disarms; the failsafe ends, so the autopilot reports the requested mode again."""
        self.armed, self.landed_state, self.mode = False, ON_GROUND, self.requested_mode
        self.send_heartbeat()
        self.send_current_mode()


class OffboardTestbed(MemoryTestbed):
    """A testbed with a stream for every vehicle."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.streamer = Streamer(self.clock, InLoopScheduler(self.clock))
        self.fleet.on_vehicle_added(self.streamer.attach)
        self.supervisor.repeat("offboard-beat", lambda: self.streamer.update_once(), SNAPSHOT_PERIOD_S)
        self.supervisor.start("stream", self._run_scheduler)

    async def _run_scheduler(self) -> None:
        while True:
            self.streamer._streams.step()
            await self.clock.sleep(STEP_S)

    def offboard_autopilot(self, link: Any, *, peer: str = "peer", **options: Any) -> OffboardAutopilot:
        autopilot = OffboardAutopilot(link, peer=peer, **options)
        link.autopilots[peer] = autopilot
        return autopilot


def stream_request(
    *,
    position: tuple[float, float, float] | None = (0.0, 0.0, -5.0),
    velocity: tuple[float, float, float] | None = None,
    valid_for_s: float = 60.0,
    action: str = "hold",
    hold_for_s: float = 1.0,
    client: str = "test",
) -> StreamRequest:
    setpoint = Velocity(velocity, yaw_ned_rad=0.0) if velocity else Position(position, yaw_ned_rad=0.0)
    return StreamRequest(setpoint, valid_for_s, OnExpiry(action, hold_for_s), client)


async def sleep(duration_s: float) -> None:
    """Waits on simulated time."""
    await asyncio.sleep(duration_s)


def run_offboard(run_simulated, scenario, *, flying=True, loss=0.0, seed=0):
    """Runs a scenario with a testbed, the server's vehicle, the scripted autopilot and the link."""

    async def run():
        testbed = OffboardTestbed()
        link = testbed.link()
        autopilot = testbed.offboard_autopilot(link, loss=loss, seed=seed)
        if flying:
            autopilot.set_hovering()
        try:
            vehicle = await testbed.wait_for_vehicle()
            await sleep(1.5)
            await scenario(testbed, vehicle, autopilot, link)
        finally:
            await testbed.close()

    run_simulated(run)


def offboard_event_codes(vehicle):
    """Codes of the vehicle's events about its setpoint stream."""
    return [e.data["code"] for e in vehicle.events.since() if (e.data or {}).get("source") == "offboard"]


def setpoint_gaps_s(autopilot):
    return [b - a for (a, _), (b, _) in itertools.pairwise(autopilot.setpoints)]


def mode_requests(autopilot, mode):
    """Received DO_SET_MODE commands for this mode."""
    return [
        m
        for m in autopilot.received_commands(sim.MAV_CMD_DO_SET_MODE)
        if (int(m.param2) << 16 | int(m.param3) << 24) == mode
    ]


async def assert_nothing_sent(autopilot, link, duration_s=3.0, settle_s=0.02):
    """Checks that the autopilot receives neither setpoints nor mode requests."""
    await sleep(settle_s)
    setpoints, commands = len(autopilot.setpoints), len(autopilot.received_commands(sim.MAV_CMD_DO_SET_MODE))
    await sleep(duration_s)
    assert len(autopilot.setpoints) == setpoints
    assert len(autopilot.received_commands(sim.MAV_CMD_DO_SET_MODE)) == commands
