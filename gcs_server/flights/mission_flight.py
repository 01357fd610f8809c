"""One offboard mission on one vehicle: passes the vehicle's state to the runner and executes its requests."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Generator
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from gcs_server.clock import Clock
from gcs_server.errors import GcsError, Refused
from gcs_server.flights.executor import IF_SILENT_IN_PX4_MODE, PX4_MODES, MissionExecutor
from gcs_server.flights.mission_values import OffboardMissionStatus, Start
from gcs_server.flights.readings import above_home_m, stream_reading
from gcs_server.ros2.external_mode import IF_SILENT
from gcs_server.streamer.offboard.control import OffboardControl
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.streamer.process.streams import Streams
from gcs_server.streamer.values.stream_request import OFFBOARD, OnExpiry, StreamRequest
from gcs_server.vehicle.services.camera import CameraService
from gcs_server.vehicle.tickets import Ticket
from gcs_server.vehicle.vehicle import Vehicle
from missions.avoidance.corridor import first_on_line
from missions.offboard.segments import CurveSegment
from missions.runner.flown import FlightRecord, FlownMission, planned_by_mission, state_in_mission
from missions.runner.reading import Reading
from missions.runner.requests import (
    CannotDo,
    ChangeScript,
    Notify,
    Photo,
    PointGimbal,
    ReleaseGimbal,
    Request,
    SetMode,
    StopStream,
    StreamScript,
    TakeOff,
)
from missions.runner.runner import Runner

if TYPE_CHECKING:
    from gcs_server.flights.group_mission import GroupMission

P = ParamSpec("P")
T = TypeVar("T")
Spawn = Callable[[str, Coroutine[Any, Any, None]], asyncio.Task[Any]]
"""Starts a background task with a name."""
RENEWAL_TIMEOUT_S = 3.0
"""Time without an update of the mission after which the stream holds the position, then switches to PX4's
Hold mode [s]."""
HOLD_FOR_S = 5.0
"""Time for which the stream then holds the position, before it requests Hold mode [s]."""
STREAMED = ("streaming", "interrupted")
"""Phases of a stream whose setpoints a mission can replace."""
RATE_HZ = 50.0
MAX_PICTURES_WAITING = 5
WARNING, NOTICE = 4, 5


class MissionFlight:
    """A mission of one vehicle, from its start to its end.

    Args:
        clock: the server's clock.
        control: the vehicle's setpoint stream.
        streams: the streams of all vehicles.
        spawn: starts a background task.
        start: the mission.
    """

    def __init__(
        self, clock: Clock, control: OffboardControl, streams: Streams, spawn: Spawn, start: Start
    ) -> None:
        self._clock = clock
        self._control, self._vehicle, self._streams = control, control.vehicle, streams
        self._spawn = spawn
        self.start = start
        self._executor = MissionExecutor(clock, control.vehicle, streams, start.mode)
        self.runner = Runner(
            start.timeline,
            start.mission.name,
            start.motion,
            start.low_battery_share,
            start.corridor,
            start.mode,
        )
        self.group: GroupMission | None = None
        """The mission of the vehicle's group; None before the start, and for a mission of one vehicle."""
        self.updated_s = self._now_s
        """Time of the runner's last update."""
        origin = VehicleEstimates(self._vehicle).origin()
        reading = self.reading()
        start_ned_m = reading.position_ned_m or (0.0, 0.0, 0.0)
        self._record = FlightRecord(
            start.mission.name, clock.unix_s(), self._now_s, reading, origin,
            cache(lambda: planned_by_mission(start.timeline, start_ned_m)),
        )  # fmt: skip
        self._client_ticket: Ticket | None = None
        """Ticket of the client's command that is being executed by the runner in this call."""
        self._followed: Ticket | None = None
        """The newest claimed ticket when a client last commanded this mission."""
        self._task: asyncio.Task[Any] | None = None
        """The running command; a newer command cancels it."""
        self._ticket: Ticket | None = None
        """Ticket of the newest command."""
        self._request: TakeOff | StreamScript | SetMode | None = None
        """The newest command."""
        self._pictures = 0
        self._gimbal_requested = False
        self._controls_gimbal = False

    # --- requests of clients ------------------------------------------------------------------------

    @contextmanager
    def commanded(self, ticket: Ticket) -> Generator[None]:
        """Block in which this mission executes a client's command: what the mission commands in this block
        follows the client's command instead of yielding to it. The block must not wait.

        Raises:
            Interrupted: the client's ticket was cancelled.
        """
        ticket.require()
        self._client_ticket = ticket
        try:
            yield
        finally:
            self._client_ticket = None
            self._followed = self._vehicle.tickets.newest_claimed

    def begin(self) -> None:
        """Starts the mission. Raises Refused if this is not possible now."""
        self.require_attitude()
        self.execute_requests(call_runner(self.runner.start, self._now_s, self.reading()))

    def require_attitude(self) -> None:
        """Raises Refused if the vehicle does not report its attitude."""
        if self.reading().estimates is None:
            raise Refused(
                f"Vehicle {self._vehicle.id} does not report its attitude now.",
                remedy="Check its link, then try again.",
            )

    def pause(self, by: str) -> None:
        """Pauses the mission for all its vehicles. Raises Refused if this is not possible now."""
        if self.group is not None:
            self.group.pause(by)
        else:
            self._execute(call_runner(self.runner.pause, self._now_s, self.reading(), by))

    def resume(self, by: str) -> None:
        """Resumes the mission for all its vehicles. Raises Refused if this is not possible now."""
        if self.group is not None:
            self.group.resume(by)
        else:
            self._execute(call_runner(self.runner.resume, self._now_s, self.reading(), by))

    def skip(self, by: str) -> None:
        """Skips the current step. Raises Refused if this is not possible now, or if the mission has several
        vehicles."""
        if self.group is not None:
            raise Refused(
                "A step of a mission of several vehicles cannot be skipped: "
                "the vehicles would no longer fly together.",
                remedy="Pause or abort the mission, which acts on all of them.",
            )
        self._execute(call_runner(self.runner.skip, self._now_s, self.reading(), by))

    def go_on(self, by: str) -> None:
        """Continues after a wait for the operator. Raises Refused if the mission is not waiting for the
        operator."""
        self._execute(call_runner(self.runner.continue_after_question, by))

    def abort(self, by: str, then: str) -> None:
        """Ends the mission for all its vehicles. Raises Refused if the mission has ended."""
        if self.group is not None:
            self.group.abort(by, then)
            return
        self._execute(call_runner(self.runner.abort, self.reading(), by, then))

    # --- time -------------------------------------------------------------------------------------

    def update(self) -> None:
        """Updates the runner; called about ten times a second."""
        if not self.runner.over:
            reading = self.reading()
            self._execute(self.runner.tick(self._now_s, reading))
            self.updated_s = self._now_s
            self._record.record(self._now_s, reading, state_in_mission(reading, self.runner.status(reading)))
        else:
            self.updated_s = self._now_s
        if self.runner.over:
            self._record.end(self._now_s)

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle."""
        return self._vehicle

    @property
    def vehicle_id(self) -> str:
        """Id of the vehicle."""
        return self._vehicle.id

    @property
    def mode(self) -> str:
        """Mode in which the mission is flown (`Start.mode`)."""
        return self.start.mode

    @property
    def overtaken_by(self) -> Ticket | None:
        """A command for the vehicle that was accepted, and may be done, since a client last commanded this
        mission: a mission that waits on the ground, such as for the common start, must not take off after
        it."""
        newest = self._vehicle.tickets.newest_claimed
        return None if newest is self._followed else newest

    @property
    def over(self) -> bool:
        """Whether the mission is done, aborted or stopped."""
        return self.runner.over

    def reading(self) -> Reading:
        """The current state of the vehicle, for the runner."""
        reading = stream_reading(self._control, self._streams.state(self._vehicle.id))
        executor = self._executor
        if executor.state is None:
            return reading
        in_charge, complete = executor.in_charge, executor.take_off_complete
        return reading._replace(executor_in_charge=in_charge, take_off_complete=complete)

    def status(self) -> OffboardMissionStatus:
        """Status of the mission."""
        reading = self.reading()
        result = self.runner.status(reading)
        mission = self.start.mission
        return OffboardMissionStatus(
            state=result.state,  # type: ignore[arg-type]
            name=mission.name,
            plan_id=mission.plan_id,
            version=mission.version,
            client=self.start.client,
            role=self.start.role,
            others=() if self.group is None else self.group.other_vehicle_ids(self),
            started_unix_s=self._record.started_unix_s,
            place=result.place,
            title=result.title,
            duration_s=round(self.start.timeline.duration_s, 1),
            remaining_s=None if result.remaining_s is None else round(result.remaining_s, 1),
            deviation_m=_centimetres(result.deviation_m),
            outside_corridor_m=_centimetres(result.outside_corridor_m),
            dry_run=self.start.dry_run,
            mode=self.mode,
            executor_in_charge=reading.executor_in_charge,
            question=result.question,
            reason=result.reason,
            if_stream_stops=self._if_stream_stops(),
        )

    def flown(self) -> FlownMission:
        """The flight so far, with its plan."""
        if self.runner.over:
            self._record.end(self._now_s)
        return self._record.flown(self._now_s)

    def execute_requests(self, requests: list[Request]) -> None:
        """Executes requests of the runner, after setting whether the mission uses obstacle avoidance."""
        self._control.avoidance.mission_way = self.start.timeline.avoidance
        self._execute(requests)

    def run_isolated(self, work: Callable[[], None]) -> None:
        """Runs work so that its faults affect only this vehicle."""
        self._vehicle.isolation.run("its offboard mission", work)

    # --- inside -----------------------------------------------------------------------------------

    def _if_stream_stops(self) -> str | None:
        if self.mode != OFFBOARD:
            return IF_SILENT_IN_PX4_MODE if self._vehicle.status.mode in PX4_MODES else IF_SILENT
        failsafe = self._control.failsafe()
        return None if failsafe is None else failsafe.words

    @property
    def _now_s(self) -> float:
        return self._clock.monotonic_s()

    @property
    def _by(self) -> str:
        return f"The mission {self.start.mission.name!r}"

    def _execute(self, requests: list[Request]) -> None:
        for request in requests:
            match request:
                case Notify():
                    self._add_event(request)
                case ChangeScript():
                    self._streams.change_script(self._vehicle.id, request.change)
                case StopStream():
                    self._stop_stream()
                case TakeOff() | StreamScript() | SetMode():
                    if isinstance(request, SetMode) and self._vehicle.status.mode == self.mode != OFFBOARD:
                        self._complete_mode()
                    self._command(request)
                case Photo():
                    self._take_picture(request)
                case PointGimbal():
                    self._point_gimbal(request)
                case ReleaseGimbal():
                    self._gimbal_requested = self._controls_gimbal = False
                    self._spawn(
                        "mission gimbal", self._report_failure(request, self._vehicle.gimbal.release_control)
                    )
        if self.runner.over:
            self._control.avoidance.mission_way = None
        if not self.runner.in_charge and isinstance(self._request, TakeOff | StreamScript):
            self._cancel_command()  # such as the take-off of a mission that was aborted meanwhile

    def _add_event(self, request: Notify) -> None:
        data = {"source": "offboard_mission", "code": request.code, "mission": self.start.mission.name}
        text = f"Mission {self.start.mission.name!r}: {request.text}"
        kind, severity = ("warning", WARNING) if request.warning else ("command", NOTICE)
        self._vehicle.events.add(kind, self._clock.unix_s(), text, severity=severity, data=data)

    def _stop_stream(self) -> None:
        """Cancels the running command and ends the stream, because another party controls the vehicle."""
        self._cancel_command()
        state = self._streams.state(self._vehicle.id)
        if state.request is not None and state.request.owner == "mission" and state.phase in STREAMED:
            self._streams.end(self._vehicle.id, "mission", f"{self._by} was interrupted.", state.number)

    def _complete_mode(self) -> None:
        """Reports to PX4 that the mission's mode has ended, before the vehicle leaves the mode."""
        success = self.runner.in_charge or self.runner.status(self.reading()).state == "done"
        self._streams.complete_mode(self._vehicle.id, self.mode, success)

    def _cancel_command(self) -> None:
        if self._task is not None:
            self._task.cancel()
        if self._ticket is not None:
            self._ticket.close()
        self._request = None

    def _command(self, request: TakeOff | StreamScript | SetMode) -> None:
        """Runs a command in the background, unless a client's command is being executed: the mission never
        replaces it."""
        self._cancel_command()
        # Decided now, not when the task runs: PX4 rejects a command of the executor after a pilot or another
        # station has taken over, but a command that does not use the executor would override them.
        by_executor = self._executor.in_charge
        if self._client_ticket is not None:
            self._client_ticket.claim()
        tickets = self._vehicle.tickets
        self._request, self._ticket = request, tickets.open(self._by, yields=True)
        ticket = self._ticket
        replaced_by = tickets.commanding(but=self._client_ticket)
        if isinstance(request, TakeOff) and self._client_ticket is None:
            replaced_by = replaced_by or self.overtaken_by
        if replaced_by is not None:
            ticket.cancel(f"Interrupted by “{replaced_by.label}”.")

        async def run() -> None:
            try:
                await self._run_command(request, by_executor, ticket)
            finally:
                ticket.close()

        self._task = self._spawn("mission command", self._report_failure(request, run))

    async def _report_failure(
        self, request: Request, work: Callable[[], Coroutine[Any, Any, object]]
    ) -> None:
        """Runs a command; reports a failure to the runner."""
        try:
            await work()
        except GcsError as error:
            self._execute(self.runner.request_failed(request, self.reading(), str(error)))

    async def _run_command(
        self, request: TakeOff | StreamScript | SetMode, by_executor: bool, ticket: Ticket
    ) -> None:
        command, executor = self._vehicle.command, self._executor
        if isinstance(request, TakeOff) and executor.state is not None:
            await executor.take_off(request.height_m, self._by, ticket)
        elif isinstance(request, TakeOff):
            height_m = above_home_m(self._vehicle) + request.height_m
            await command.takeoff(height_m, by=self._by, ticket=ticket)
        elif isinstance(request, StreamScript):
            await self._stream_script(request, by_executor, ticket)
        elif request.mode == "hold":
            if self._streams.state(self._vehicle.id).phase != "idle":
                await self._control.stop(ticket)
            if self._vehicle.status.mode != "hold":
                await command.hold(by=self._by, ticket=ticket)
        elif by_executor:
            await executor.set_mode(request.mode, self._by, ticket)
        else:
            await (command.land if request.mode == "land" else command.rtl)(by=self._by, ticket=ticket)

    async def _stream_script(self, request: StreamScript, by_executor: bool, ticket: Ticket) -> None:
        self._check_approach(request.script.approach)
        on_expiry = OnExpiry("hold", HOLD_FOR_S)
        name = self.start.mission.name
        stream_request = StreamRequest(
            request.script, RENEWAL_TIMEOUT_S, on_expiry, name, owner="mission", mode=self.mode
        )
        state = self._streams.state(self._vehicle.id)
        if state.request is not None and state.request.owner == "mission" and state.phase in STREAMED:
            await self._control.setpoint(stream_request)
        else:

            async def select(own: Ticket) -> None:
                await self._executor.set_mode(self.mode, self._by, own)

            await self._control.start(stream_request, RATE_HZ, select if by_executor else None, ticket)

    def _check_approach(self, approach: CurveSegment | None) -> None:
        """Raises Refused if the sensors measure an obstacle on the straight line to the path."""
        avoidance = self._control.avoidance
        position = None if approach is None else self.reading().position_ned_m
        if (
            approach is None
            or position is None
            or avoidance.way
            or (avoidance.mission_way and approach.avoidance)
        ):
            return
        obstacle_m = first_on_line(VehicleEstimates(self._vehicle).scans(), position, approach.end_ned_m)
        if obstacle_m is not None:
            raise Refused(
                f"An obstacle is measured {obstacle_m:.0f} m ahead on the straight line to the path.",
                remedy="Fly around it by hand, or switch obstacle avoidance on, then resume.",
            )

    def _take_picture(self, request: Photo) -> None:
        if self._pictures >= MAX_PICTURES_WAITING:
            self._execute(self.runner.request_failed(request, self.reading(), "the camera is too slow"))
            return
        self._pictures += 1

        async def take_picture() -> None:
            try:
                await self._vehicle.service(CameraService).take_picture(request.component)
            finally:
                self._pictures -= 1

        self._spawn("mission photo", self._report_failure(request, take_picture))

    def _point_gimbal(self, request: PointGimbal) -> None:
        if self._controls_gimbal:
            self._vehicle.gimbal.point(request.pitch_rad, request.yaw_ned_rad)
        elif not self._gimbal_requested:
            self._gimbal_requested = True

            async def take_control() -> None:
                await self._vehicle.gimbal.take_control()
                self._controls_gimbal = True

            self._spawn("mission gimbal", self._report_failure(request, take_control))


def _centimetres(value: float | None) -> float | None:
    return None if value is None else round(value, 2)


def call_runner(method: Callable[P, T], *arguments: P.args, **keywords: P.kwargs) -> T:
    """Calls the runner for a client. Raises Refused if the runner cannot do this now."""
    try:
        return method(*arguments, **keywords)
    except CannotDo as error:
        raise Refused(f"The mission cannot do that: {error}.", remedy=error.remedy) from error
