"""The event loop's side of a vehicle's stream: checks, starts, stops, and says how it stands."""

from __future__ import annotations

import asyncio
import math
from dataclasses import asdict, dataclass

from gcs_server.clock import Clock
from gcs_server.errors import GcsError, NoReply, Refused, Rejected
from gcs_server.streamer.failsafe import MAV_SYS_STATUS_SENSOR_RC_RECEIVER, Failsafe
from gcs_server.streamer.news import Snapshot
from gcs_server.streamer.setpoints import OnExpiry, Order, Vector3
from gcs_server.streamer.thread import StreamThread
from gcs_server.supervise import Supervisor
from gcs_server.vehicle.samples import Attitude, Estimator, Health, LocalPosition
from gcs_server.vehicle.vehicle import Vehicle

BEAT_PERIOD_S = 0.1
PRE_STREAM_S = 1.2
"""PX4 wants more than a second of setpoints before it takes Offboard."""
ESTIMATE_FRESH_S = 1.0
STOP_ALL_S = 3.0
"""How long the server's end may wait for all vehicles to be in Hold."""
SETPOINT_MAX_DISTANCE_M = 1000.0
_FLAG_VELOCITY_HORIZONTAL, _FLAGS_POSITION_HORIZONTAL = 2, 8 | 16  # ESTIMATOR_STATUS_FLAGS
MESSAGE_OF_NO_STREAM = "There is no setpoint stream to this vehicle, so a setpoint has nowhere to go."


@dataclass(frozen=True, slots=True)
class OffboardStatus:
    """The topic `offboard`, and what `GET …/offboard` answers."""

    streaming: bool
    """Whether setpoints go out to the vehicle now."""
    state: str
    """idle, starting, streaming, holding (expired, place held), to_hold, landing (mode asked for), undoing
    (the start failed, but the vehicle may yet take Offboard)."""
    client: str | None
    """Whose setpoint it is."""
    setpoint: dict[str, object] | None
    """What goes out now: the client's, or the place held after it expired."""
    rate_hz: float
    rate_achieved_hz: float | None
    age_s: float | None
    valid_for_s: float | None
    valid_left_s: float | None
    on_expiry: dict[str, object] | None
    if_stream_stops: str | None
    """What the vehicle will do by itself, in words; None before it was asked."""
    sends_failed: int
    """Setpoints that could not be handed to the link."""
    ended: str | None
    """Why the last stream ended; None while one runs or before the first."""


class OffboardControl:
    """A vehicle's attribute `offboard`."""

    def __init__(self, clock: Clock, vehicle: Vehicle, thread: StreamThread) -> None:
        self._clock = clock
        self._vehicle = vehicle
        self._thread = thread
        self._failsafe: Failsafe | None = None
        self._asked = 0
        """The number of the stream for which Offboard has been asked for."""
        vehicle.command.on_mode_command = lambda: thread.refrain(vehicle.id)
        identity = vehicle.identity
        thread.attach(vehicle.id, vehicle, (identity.system_id, identity.component_id))

    async def start(self, order: Order, rate_hz: float = 50.0) -> OffboardStatus:
        """Streams, asks for Offboard, and returns once the vehicle reports it; from any other mode.

        Where Offboard was asked for and its coming is in doubt (no answer, another command, the caller gone),
        the stream goes on for `UNDO_S` and puts the vehicle into Hold should it take Offboard yet.

        Raises:
            Refused: an estimate is missing, the target is too far, or somebody streams already.
            Rejected: the vehicle refused Offboard; the stream has been stopped.
        """
        vehicle = self._vehicle
        vehicle.require_commandable()
        status = vehicle.status
        if status.mode == "offboard" and status.armed and not self._thread.state(vehicle.id).order:
            raise Refused(
                f"Vehicle {vehicle.id} already flies Offboard by somebody else's setpoints.",
                remedy="Stop the other program, or command Hold first.",
            )
        self._check(order)
        number = self._thread.begin(vehicle.id, order, rate_hz, self.snapshot())
        if not number:
            raise Refused(
                f"Vehicle {vehicle.id} is streamed to already.",
                remedy="Send a setpoint to change the target, or stop the stream first.",
            )
        try:
            began_s = self._clock.monotonic_s()
            self._check_rate(await self.read_failsafe(), rate_hz)
            await self._clock.sleep(max(0.0, PRE_STREAM_S - (self._clock.monotonic_s() - began_s)))
            self._still_starting(number)
            self._check(order)  # seconds may have passed
            self._asked = number
            await vehicle.command.set_mode("offboard")
            if not self._thread.engage(vehicle.id, self.snapshot(), number):
                self._still_starting(number)
        except BaseException as error:
            if self._asked == number and not isinstance(error, Rejected):
                self._thread.abandon(vehicle.id, self.snapshot(), number)
            else:
                reason = str(error) or "it was cancelled"
                self._thread.end(vehicle.id, "refused", f"Offboard did not start: {reason}", number)
            raise
        return self.status()

    def _still_starting(self, number: int) -> None:
        if not self._thread.starting(self._vehicle.id, number):
            ended = self._thread.state(self._vehicle.id).last_end
            raise Refused(ended.text if ended else "The stream was stopped while it started.")

    @staticmethod
    def _check_rate(failsafe: Failsafe, rate_hz: float) -> None:
        """Two setpoints must fit into the vehicle's patience, so that one may be lost."""
        patience_s = failsafe.loss_timeout_s
        if patience_s is not None and 2.0 / rate_hz > patience_s:
            raise Refused(
                f"{rate_hz:g} setpoints a second are too few: the vehicle gives up after {patience_s:g} s "
                "(COM_OF_LOSS_T).",
                remedy=f"Stream at {math.ceil(2.0 / max(patience_s, 0.02)):d} Hz or more.",
            )

    def setpoint(self, order: Order) -> OffboardStatus:
        """A new target, sent at once.

        Raises:
            Refused: no stream runs, an estimate is missing, or the target is too far.
        """
        self._vehicle.require_commandable()
        state = self._thread.state(self._vehicle.id)
        if state.phase == "idle":
            ended = f" It ended: {state.last_end.text}" if state.last_end else ""
            raise Refused(
                MESSAGE_OF_NO_STREAM + ended,
                remedy="Call offboard/start with a setpoint first; it streams, then switches to Offboard.",
            )
        self._check(order)
        if not self._thread.change(self._vehicle.id, order, self.snapshot()):
            raise Refused(
                "The stream is just ending (the vehicle is being put into Hold or Land).",
                remedy="Wait for it to end, then call offboard/start again.",
            )
        return self.status()

    async def stop(self) -> OffboardStatus:
        """Puts the vehicle into Hold, waits for its own word, then stops; nothing is sent afterwards.

        Without a stream nothing is done: the vehicle is not ours to put into Hold. A landing that the order
        asked for on its expiry goes on.
        """
        vehicle = self._vehicle
        state = self._thread.state(vehicle.id)
        if state.phase in ("idle", "landing"):
            return self.status()
        self._thread.wind_down(vehicle.id, self.snapshot())
        may_come = state.phase in ("starting", "undoing") and self._asked == state.number
        if may_come or vehicle.status.mode == "offboard":
            await vehicle.command.set_mode("hold")
        self._thread.end(vehicle.id, "stopped", "The stream was stopped.", state.number)
        return self.status()

    async def read_failsafe(self) -> Failsafe:
        """Asks the vehicle what it does when the stream stops; what it does not tell stays unknown."""
        values: dict[str, float | None] = {}
        for name in ("COM_OF_LOSS_T", "COM_OBL_RC_ACT"):
            try:
                values[name] = (await self._vehicle.params.get(name)).value
            except NoReply:
                values[name] = None
        action = values["COM_OBL_RC_ACT"]
        self._failsafe = Failsafe(
            values["COM_OF_LOSS_T"], None if action is None else int(action), self._hears_transmitter()
        )
        return self._failsafe

    async def status_with_failsafe(self) -> OffboardStatus:
        """As `status`, having asked the vehicle where that was not known and can be."""
        if self._failsafe is None:
            try:
                self._vehicle.require_commandable()
                await self.read_failsafe()
            except GcsError:
                pass  # replayed, lost or of another kind: it stays unknown, and the status says the rest
        return self.status()

    def status(self) -> OffboardStatus:
        """How the stream stands, now."""
        state = self._thread.state(self._vehicle.id)
        sent = self._thread.sent_setpoint(self._vehicle.id)
        order = state.order
        fields: dict[str, object] | None = None
        if sent is not None:
            fields = {"type": sent.type, **{k: v for k, v in asdict(sent).items() if v is not None}}
        return OffboardStatus(
            streaming=state.phase != "idle",
            state=state.phase,
            client=order.client if order else None,
            setpoint=fields,
            rate_hz=state.rate_hz,
            rate_achieved_hz=state.rate_achieved_hz,
            age_s=state.age_s,
            valid_for_s=order.valid_for_s if order else None,
            valid_left_s=state.valid_left_s,
            on_expiry=_expiry(order.on_expiry) if order else None,
            if_stream_stops=self._failsafe.words() if self._failsafe else None,
            sends_failed=state.sends_failed,
            ended=state.last_end.text if state.last_end and state.phase == "idle" else None,
        )

    def snapshot(self) -> Snapshot:
        """The vehicle as the stream's thread is to know it."""
        now_s = self._clock.monotonic_s()
        local = self._fresh("local_position", now_s)
        attitude = self._fresh("attitude", now_s)
        status = self._vehicle.status
        mode = status.mode
        asked = self._vehicle.command.asked_for(mode)
        usable = isinstance(local, LocalPosition) and self._estimator_has(_FLAGS_POSITION_HORIZONTAL)
        return Snapshot(
            now_s,
            mode,
            local.position_ned_m if usable and isinstance(local, LocalPosition) else None,
            local.velocity_ned_m_s if isinstance(local, LocalPosition) else None,
            attitude.yaw_ned_rad if isinstance(attitude, Attitude) else None,
            None if asked is None else f"{asked.by or 'The server'} commanded {asked.what!r}",
            estimate_s=self._heard_s("local_position") if usable else None,
            armed=status.armed,
            lost=status.link_lost or not self._vehicle.endpoints,
        )

    def _heard_s(self, topic: str) -> float | None:
        sample = self._vehicle.topic(topic)
        return None if sample is None else sample.received_monotonic_s

    def _fresh(self, topic: str, now_s: float) -> object | None:
        sample = self._vehicle.topic(topic)
        if sample is None or now_s - sample.received_monotonic_s > ESTIMATE_FRESH_S:
            return None
        return sample.value

    def _estimator_has(self, flags: int) -> bool:
        """True too where the vehicle does not send its estimator's flags."""
        sample = self._vehicle.topic("estimator")
        return sample is None or not isinstance(sample.value, Estimator) or sample.value.flags & flags != 0

    def _hears_transmitter(self) -> bool:
        sample = self._vehicle.topic("health")
        if sample is None or not isinstance(sample.value, Health):
            return False
        health = sample.value
        return bool(health.sensors_present & health.sensors_healthy & MAV_SYS_STATUS_SENSOR_RC_RECEIVER)

    def _check(self, order: Order) -> None:
        snapshot = self.snapshot()
        target = order.setpoint.position_ned_m
        remedy = "Wait for GPS and the estimator (see the vehicle's messages), then try again."
        if snapshot.velocity_ned_m_s is None or not self._estimator_has(_FLAG_VELOCITY_HORIZONTAL):
            raise Refused("The vehicle has no fresh velocity estimate, which Offboard needs.", remedy=remedy)
        if target is None:
            return
        if snapshot.position_ned_m is None:
            raise Refused(
                "The vehicle has no fresh position estimate, which a position setpoint needs.", remedy=remedy
            )
        distance_m = math.dist(target, snapshot.position_ned_m)
        if distance_m > SETPOINT_MAX_DISTANCE_M:
            raise Refused(
                f"The target is {distance_m:.0f} m from the vehicle; setpoints may be at most "
                f"{SETPOINT_MAX_DISTANCE_M:.0f} m away.",
                remedy="Coordinates are metres north, east, down of the vehicle's local origin.",
            )


def _expiry(on_expiry: OnExpiry) -> dict[str, object]:
    if on_expiry.action == "hold":
        return {"action": "hold", "hold_for_s": on_expiry.hold_for_s}
    return {"action": on_expiry.action}


@dataclass(frozen=True, slots=True)
class Stopped:
    """What became of one vehicle's stream when the server ended."""

    vehicle: str
    error: GcsError | None
    """None where the vehicle is in Hold."""
    duration_s: float


class Streamer:
    """The thread and the loop's beat that keeps it informed; builds each vehicle's `offboard`."""

    def __init__(self, clock: Clock, *, server_silent_limit_s: float = 1.5) -> None:
        self._clock = clock
        self._thread = StreamThread(clock, server_silent_limit_s=server_silent_limit_s)
        self._vehicles: dict[str, Vehicle] = {}

    def attach(self, vehicle: Vehicle) -> None:
        """Gives a vehicle its offboard control."""
        self._vehicles[vehicle.id] = vehicle
        vehicle.offboard = OffboardControl(self._clock, vehicle, self._thread)

    def start(self, supervisor: Supervisor) -> None:
        """Begins the thread and its beat."""
        self._thread.start()
        supervisor.start("offboard-beat", self._beat)

    def close(self) -> None:
        """Stops all streams: the vehicles fail safe."""
        self._thread.close()

    def target(self, vehicle_id: str) -> tuple[Vector3 | None, Vector3 | None, float | None] | None:
        """(position, velocity, yaw) streamed now, for the scene's ghost; None while nothing is."""
        sent = self._thread.sent_setpoint(vehicle_id)
        return None if sent is None else (sent.position_ned_m, sent.velocity_ned_m_s, sent.yaw_ned_rad)

    async def stop_all(self) -> list[Stopped]:
        """Puts every vehicle that is streamed to into Hold, all at once (a clean end of the server).

        One that is not there within `STOP_ALL_S` loses its stream and fails safe.
        """
        async with asyncio.TaskGroup() as group:
            stops = [group.create_task(self._stop_one(vehicle_id)) for vehicle_id in self._thread.active()]
        return [stop.result() for stop in stops]

    async def _stop_one(self, vehicle_id: str) -> Stopped:
        began_s = self._clock.monotonic_s()
        error: GcsError | None = None
        try:
            async with asyncio.timeout(STOP_ALL_S):
                await self._vehicles[vehicle_id].offboard.stop()
        except GcsError as problem:
            error = problem
        except TimeoutError:
            error = NoReply(
                f"Vehicle {vehicle_id} did not report Hold before the server ended; it fails safe.",
                deadline_s=STOP_ALL_S,
            )
        if error is not None:
            self._tell(vehicle_id, f"It could not be put into Hold at the server's end: {error}", 4)
        return Stopped(vehicle_id, error, self._clock.monotonic_s() - began_s)

    async def _beat(self) -> None:
        while True:
            self.beat_once()
            await self._clock.sleep(BEAT_PERIOD_S)

    def beat_once(self) -> None:
        """Shows that the loop lives, renews the snapshots and tells what the thread reported."""
        self._thread.beat({vid: self._vehicles[vid].offboard.snapshot() for vid in self._thread.active()})
        for vehicle_id, report in self._thread.take_reports():
            self._tell(vehicle_id, report.text, report.severity, report.code)

    def _tell(self, vehicle_id: str, text: str, severity: int, code: str = "offboard") -> None:
        kind = "warning" if severity <= 4 else "command"
        self._vehicles[vehicle_id].events.add(
            kind, self._clock.unix_s(), text, severity=severity, data={"source": "offboard", "code": code}
        )
