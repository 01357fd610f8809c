"""The event loop's interface to one vehicle's stream: checks, start, stop, and status."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable, Sequence

from gcs_server.clock import Clock
from gcs_server.errors import InvalidRequest, NoReply, Refused, Rejected
from gcs_server.streamer.device import check_device
from gcs_server.streamer.offboard.avoidance import AvoidanceControl
from gcs_server.streamer.offboard.configuration import OffboardConfiguration
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.streamer.offboard.limit_store import VehicleOperatorLimits
from gcs_server.streamer.offboard.snapshots import FindVehicle, VehicleSnapshots
from gcs_server.streamer.offboard.status import (
    FailsafeView,
    OffboardLimits,
    OffboardStatus,
    expiry_view,
    health_of,
    setpoint_view,
)
from gcs_server.streamer.process.streams import Streams
from gcs_server.streamer.validation import Availability, Available, check_segments, check_target, problem_of
from gcs_server.streamer.values.limit_values import vehicle_limits
from gcs_server.streamer.values.snapshot import Snapshot
from gcs_server.streamer.values.stream_request import OFFBOARD, StreamRequest
from gcs_server.vehicle.endpoint import ROS2, protocol_in_use, unusable_topics
from gcs_server.vehicle.px4.stream_loss import ACTION_MODES, StreamLoss
from gcs_server.vehicle.services.transaction import ReportProgress
from gcs_server.vehicle.settling import settled
from gcs_server.vehicle.tickets import Ticket
from gcs_server.vehicle.vehicle import Vehicle
from missions.offboard.segments import Segment
from missions.runner.script import Script
from missions.setpoints import Follow, FollowDevice, Position

PRE_STREAM_S = 1.2
"""Time for which setpoints are streamed before Offboard is requested [s]; PX4 requires more than 1 s."""
PRE_STREAM_TIMEOUT_S = 6.0
"""Maximum time until setpoints have been sent without a pause for `PRE_STREAM_S` [s]; if it takes longer, the
computer is too busy to fly a vehicle."""
CHECK_PERIOD_S = 0.02
"""Period at which the end of pre-streaming is checked [s]."""
FINAL_MODES = {"to_hold": "hold", "undoing": "hold", "landing": "land"}
"""The mode that a stream requests in each of its final phases."""
NO_STREAM = "There is no setpoint stream to this vehicle, so the setpoint was not sent."


class OffboardControl:
    """Starts, changes and stops one vehicle's stream; the attribute `offboard` of the vehicle.

    Args:
        clock: the server's clock.
        vehicle: the vehicle.
        streams: sends the setpoints.
        find: finds other vehicles by id, for following them; raises UnknownVehicle.
        limits: the operator's limits.
    """

    def __init__(
        self,
        clock: Clock,
        vehicle: Vehicle,
        streams: Streams,
        find: FindVehicle,
        limits: VehicleOperatorLimits,
    ) -> None:
        self._clock = clock
        self.vehicle = vehicle
        self._streams = streams
        self._find = find
        self._estimates = VehicleEstimates(vehicle)
        self._availability = Availability(
            self._estimates, self._protocol, lambda: unusable_topics(vehicle.endpoints)
        )
        self._configuration = OffboardConfiguration(clock, vehicle, self._estimates)
        self.operator_limits = limits
        self.avoidance = AvoidanceControl(clock, vehicle, self._estimates)
        self._snapshots = VehicleSnapshots(
            clock, vehicle, self._estimates, self._configuration, limits, self.avoidance, find
        )
        self._requested_stream = 0
        """Number of the stream for which Offboard has been requested."""
        vehicle.command.on_mode_command = lambda: streams.inhibit_mode_requests(vehicle.id)
        identity = vehicle.identity
        streams.attach(vehicle.id, vehicle, (identity.system_id, identity.component_id))

    # --- the stream -------------------------------------------------------------------------------

    async def start(
        self,
        request: StreamRequest,
        rate_hz: float = 50.0,
        select: Callable[[Ticket], Awaitable[None]] | None = None,
        ticket: Ticket | None = None,
        progress: ReportProgress | None = None,
    ) -> OffboardStatus:
        """Starts streaming, requests Offboard, and returns once the vehicle reports Offboard. The vehicle may
        be in any other mode.

        If Offboard was requested but not confirmed (no answer, another command, or a cancelled caller), the
        stream continues for `UNDO_S`. If the vehicle still switches to Offboard, the stream puts it into
        Hold.

        Args:
            request: the setpoint, and the mode in which it is flown.
            rate_hz: setpoints per second.
            select: selects the mode; None: a command of this server selects it.
            ticket: ticket of the accepted command; None: opened here.
            progress: reports what a vehicle that has just connected has not reported yet.

        Raises:
            Refused: an estimate is missing, the target is too far, or the vehicle already has a stream.
            Interrupted: the ticket was cancelled.
            Rejected: the vehicle refused Offboard; the stream has been stopped.
        """
        vehicle = self.vehicle
        vehicle.require_commandable()
        vehicle.command.require_no_kill("start Offboard")
        if request.mode != OFFBOARD and self._protocol() != ROS2:
            raise Refused(
                f"No ROS 2 connection to vehicle {vehicle.id}. Its mode takes setpoints only over ROS 2.",
                remedy="Check the ros2:// link, or fly the mission in Offboard.",
            )
        status = vehicle.status
        if status.mode == "offboard" and status.armed and not self._streams.state(vehicle.id).request:
            raise Refused(
                f"Vehicle {vehicle.id} is already in Offboard with another program's setpoints.",
                remedy="Stop the other program, or command Hold first.",
            )
        if self._streams.state(vehicle.id).phase != "idle":
            raise self._has_stream()
        own = ticket or vehicle.tickets.open("start Offboard")
        try:
            own.claim()
            await self._start(request, rate_hz, select, own, progress)
        finally:
            if ticket is None:
                own.close()
        return self.status()

    async def _start(
        self,
        request: StreamRequest,
        rate_hz: float,
        select: Callable[[Ticket], Awaitable[None]] | None,
        ticket: Ticket,
        progress: ReportProgress | None,
    ) -> None:
        vehicle = self.vehicle
        await self.operator_limits.wait_for_identity()
        if self.avoidance.way is not None:
            self.avoidance.require_sensor()
        await settled(vehicle, lambda: self.check(request), ticket=ticket, progress=progress)
        await self._streams.ready()
        vehicle.command.require_no_kill("start Offboard")
        ticket.require()
        try:
            number = await self._streams.begin(vehicle.id, request, rate_hz, self.snapshot(request))
        except ValueError as error:
            raise _cannot_fly(error) from error
        if not number:
            raise self._has_stream()
        try:
            if request.mode == OFFBOARD:
                self._check_rate(await self._configuration.read(), rate_hz)
                await self._wait_for_steady_stream(number)
            # checked again: seconds may have passed, and the vehicle's limits are known now
            self.check(request)
            vehicle.command.require_no_kill("start Offboard")
            ticket.require()
            self._requested_stream = number
            if request.mode == OFFBOARD or vehicle.status.mode != request.mode:
                await (self._request_mode(request.mode, number, ticket) if select is None else select(ticket))
            if not await self._streams.engage(vehicle.id, self.snapshot(), number):
                self._require_starting(number)
            self.operator_limits.report_at_start()
        except BaseException as error:
            if self._requested_stream == number and not isinstance(error, Rejected):
                self._streams.cancel_start(vehicle.id, self.snapshot(), number)
            else:
                reason = str(error) or ticket.reason or "it was cancelled"
                self._streams.end(vehicle.id, "refused", f"Offboard did not start: {reason}", number)
            raise

    def _has_stream(self) -> Refused:
        return Refused(
            f"Vehicle {self.vehicle.id} already has a setpoint stream.",
            remedy="Send a setpoint to change the target, or stop the stream first.",
        )

    async def _request_mode(self, mode: str, number: int, ticket: Ticket) -> None:
        """Selects the mode. Over ROS 2 requests it twice, because PX4's side of DDS may connect later than
        this one: then PX4 has received neither the first setpoints nor the request."""
        try:
            await self.vehicle.command.set_mode(mode, ticket=ticket)
        except (NoReply, Rejected):
            if self._protocol() != ROS2 or mode != OFFBOARD:
                raise
            self._require_starting(number)
            await self._clock.sleep(PRE_STREAM_S)
            await self._wait_for_steady_stream(number)
            await self.vehicle.command.set_mode(mode, ticket=ticket)

    async def _wait_for_steady_stream(self, number: int) -> None:
        """Returns once setpoints have been sent without a pause for as long as the vehicle requires.

        Raises:
            Refused: there was a pause, or the stream has ended.
        """
        until_s = self._clock.monotonic_s() + PRE_STREAM_TIMEOUT_S
        while True:
            self._require_starting(number)
            remaining_s = PRE_STREAM_S - self._streams.state(self.vehicle.id).steady_s
            if remaining_s <= 0.0:
                return
            if self._clock.monotonic_s() >= until_s:
                if self._streams.state(self.vehicle.id).sends_failed:
                    raise Refused(
                        f"Vehicle {self.vehicle.id}'s link did not accept setpoints.",
                        remedy="Check the link and its counters (GET /links), then start again.",
                    )
                raise Refused(
                    "Setpoints could not be sent without a pause: the ground station's computer is too busy.",
                    remedy="Close other programs on it, then start again.",
                )
            await self._clock.sleep(max(remaining_s, CHECK_PERIOD_S))

    def _require_starting(self, number: int) -> None:
        if not self._streams.starting(self.vehicle.id, number):
            ended = self._streams.state(self.vehicle.id).last_end
            raise Refused(ended.text if ended else "The stream was stopped while it started.")

    @staticmethod
    def _check_rate(failsafe: StreamLoss, rate_hz: float) -> None:
        """Checks that two setpoints are sent within COM_OF_LOSS_T, so that one setpoint may be lost."""
        loss_timeout_s = failsafe.loss_timeout_s
        if loss_timeout_s is not None and 2.0 / rate_hz > loss_timeout_s:
            raise Refused(
                f"{rate_hz:g} setpoints a second are too few: the vehicle's failsafe acts after "
                f"{loss_timeout_s:g} s (COM_OF_LOSS_T).",
                remedy=f"Stream at {math.ceil(2.0 / max(loss_timeout_s, 0.02)):d} Hz or more.",
            )

    async def setpoint(self, request: StreamRequest) -> OffboardStatus:
        """Sets a new setpoint, which the stream sends immediately.

        Raises:
            Refused: no stream runs, a group owns it, an estimate is missing, or the target is too far.
        """
        self.vehicle.require_commandable()
        state = self._streams.state(self.vehicle.id)
        if state.phase == "idle":
            ended = f" The last stream ended: {state.last_end.text}" if state.last_end else ""
            raise Refused(
                NO_STREAM + ended,
                remedy="Call offboard/start with a setpoint first; it streams, then switches to Offboard.",
            )
        if state.phase == "interrupted" and self.vehicle.in_failsafe:
            raise Refused(
                f"Vehicle {self.vehicle.id} has left Offboard by its failsafe; the stream keeps its place.",
                remedy="Send the setpoint again once the vehicle is back in Offboard, or command Hold.",
            )
        if state.request is not None and state.request.owner == "mission" != request.owner:
            raise Refused(
                f"Vehicle {self.vehicle.id} flies the mission {state.request.client!r}.",
                remedy="Pause or abort the mission first (offboard_mission/pause, /abort), or command Hold.",
            )
        if state.request is not None and state.request.owner == "group" != request.owner:
            raise Refused(
                f"Vehicle {self.vehicle.id} is already in a group.",
                remedy="Send the setpoint to the group (groups/{g}/setpoints), or hold the group first.",
            )
        snapshot = self.check(request)
        try:
            accepted = await self._streams.change(self.vehicle.id, request, snapshot)
        except ValueError as error:
            raise _cannot_fly(error) from error
        if not accepted:
            raise Refused(
                "The stream is ending (the vehicle is being put into Hold or Land).",
                remedy="Wait for it to end, then call offboard/start again.",
            )
        return self.status()

    async def stop(self, ticket: Ticket | None = None) -> OffboardStatus:
        """Puts the vehicle into Hold, waits for the confirmation, then stops the stream; nothing is sent
        afterwards. Does nothing if no stream is running. A landing that was started on expiry continues.

        Args:
            ticket: ticket of the accepted command, which also ends a start that has not begun the stream.
                None: no client has commanded the stop; a command that is being executed continues, and
                decides the mode.
        """
        vehicle = self.vehicle
        if ticket is not None:
            ticket.claim()
        state = self._streams.state(vehicle.id)
        if state.phase in ("idle", "landing"):
            return self.status()
        self._streams.request_stop(vehicle.id, self.snapshot())
        await vehicle.command.wait_for_kill()
        may_still_switch = state.phase in ("starting", "undoing") and self._requested_stream == state.number
        if may_still_switch or vehicle.status.mode in (
            OFFBOARD,
            state.request.mode if state.request else OFFBOARD,
        ):
            if ticket is None and vehicle.tickets.commanding() is not None:
                return self.status()
            await vehicle.command.set_mode("hold", ticket=ticket)
        self._streams.end(vehicle.id, "stopped", "The stream was stopped.", state.number)
        return self.status()

    # --- the vehicle's configuration ----------------------------------------------------------------

    def requested_mode(self) -> str | None:
        """The mode that the ending stream is requesting; None if it requests no mode."""
        return FINAL_MODES.get(self._streams.state(self.vehicle.id).phase)

    async def set_failsafe(self, action: str | None, after_s: float | None) -> FailsafeView:
        """Sets the vehicle's action when the stream stops; each value is verified.

        Raises:
            InvalidRequest: there is no such action.
            Refused: the running stream would be too slow for `after_s`.
            Rejected: the vehicle keeps another value.
        """
        if action is not None and action not in ACTION_MODES[:6]:
            raise InvalidRequest("action", f"There is no action {action!r}: {', '.join(ACTION_MODES[:6])}.")
        state = self._streams.state(self.vehicle.id)
        if after_s is not None and state.phase != "idle":
            self._check_rate(StreamLoss(after_s, None, False), state.rate_hz)
        if after_s is not None:
            await self.vehicle.params.set("COM_OF_LOSS_T", after_s)
        if action is not None:
            await self.vehicle.params.set("COM_OBL_RC_ACT", ACTION_MODES.index(action))
        view = self._failsafe_view(await self._configuration.read())
        assert view is not None
        return view

    async def ensure_parameters(self) -> None:
        """Requests the vehicle's limits and failsafe parameters that are not known yet."""
        await self._configuration.ensure()

    # --- status -------------------------------------------------------------------------------------

    def available(self) -> dict[str, Available]:
        """All setpoint types: whether each can be flown now, and why not."""
        return self._availability.all()

    def limits(self) -> OffboardLimits:
        """The limits for setpoints."""
        vehicle, operator = vehicle_limits(self._configuration.parameters()), self.operator_limits
        return OffboardLimits(vehicle, operator.limits, operator.origin())

    def failsafe(self) -> FailsafeView | None:
        """The vehicle's action when the stream stops; None if unknown."""
        return self._failsafe_view(self._configuration.failsafe())

    @staticmethod
    def _failsafe_view(failsafe: StreamLoss | None) -> FailsafeView | None:
        if failsafe is None:
            return None
        return FailsafeView(
            failsafe.loss_timeout_s, failsafe.action_mode, failsafe.transmitter, failsafe.text()
        )

    def status(self) -> OffboardStatus:
        """Status of the stream now."""
        state = self._streams.state(self.vehicle.id)
        request, failsafe = state.request, self._configuration.failsafe()
        return OffboardStatus(
            streaming=state.phase != "idle",
            state=state.phase,
            client=request.client if request else None,
            client_key=(request.client_key or None) if request else None,
            owner=request.owner if request else None,
            ordered_type=request.setpoint.type if request else None,
            setpoint=None if state.sent is None else setpoint_view(state.sent),
            limited=state.limited,
            rate_hz=state.rate_hz,
            rate_achieved_hz=state.rate_achieved_hz,
            age_s=state.age_s,
            valid_for_s=request.valid_for_s if request else None,
            valid_left_s=state.valid_left_s,
            on_expiry=expiry_view(request.on_expiry) if request else None,
            if_stream_stops=failsafe.text() if failsafe else None,
            sends_failed=state.sends_failed,
            ended=state.last_end.text if state.last_end and state.phase == "idle" else None,
            limits_origin=self.operator_limits.origin(),
            avoidance=self.avoidance.view(state),
            health=health_of(state, self._estimates, failsafe),
        )

    def snapshot(self, request: StreamRequest | None = None) -> Snapshot:
        """Snapshot of the vehicle for its stream, or for a new request that is being checked."""
        return self._snapshots.make(request or self._streams.state(self.vehicle.id).request)

    def snapshot_without_estimates(self) -> Snapshot:
        """Snapshot from the heartbeat and the previous limits only, used if `snapshot` fails."""
        return self._snapshots.without_estimates()

    # --- inside -------------------------------------------------------------------------------------

    def _protocol(self) -> str:
        return protocol_in_use(self.vehicle.endpoints, ROS2)

    def check(self, request: StreamRequest) -> Snapshot:
        """Raises Refused if the setpoint cannot be flown now, InvalidRequest if it can never be flown.
        Returns the vehicle's state that was checked.
        """
        setpoint = request.setpoint
        if isinstance(setpoint, Script):
            self._availability.require_estimates(setpoint.type, setpoint.needs)
            segments = [s for s in (setpoint.approach, *setpoint.segments) if s is not None]
            self.check_segments(segments, request.mode)
            return self.snapshot(request)
        problem = problem_of(setpoint)
        if problem is not None:
            raise InvalidRequest("setpoint", problem)
        self._availability.require(setpoint, in_offboard=request.mode == OFFBOARD)
        if isinstance(setpoint, Follow):
            self._check_leader(setpoint)
        if isinstance(setpoint, FollowDevice):
            state, position = self._streams.state(self.vehicle.id), self._estimates.global_position()
            vehicle_deg = None if position is None else (position.lat_deg, position.lon_deg)
            check_device(request, vehicle_deg, state.request, state.age_s)
        snapshot, limited = self.snapshot(request), self.operator_limits.limits.needs_position
        floor = self.vehicle.command.floor.now()
        check_target(setpoint, self._clock.monotonic_s(), snapshot, floor, has_position_limits=limited)
        return snapshot

    def check_segments(self, segments: Sequence[Segment], mode: str) -> None:
        """Raises Refused if segments leave the position limits, go below the ground, or need a topic in an
        unknown version."""
        self.require_topics(segments, in_offboard=mode == OFFBOARD)
        limited = self.operator_limits.limits.needs_position
        floor = self.vehicle.command.floor.now()
        check_segments(segments, self.snapshot(), floor, has_position_limits=limited)

    def require_topics(self, segments: Sequence[Segment], *, in_offboard: bool) -> None:
        """Raises Refused if the vehicle has a topic of these segments' setpoints in an unknown version."""
        types = {Position.type, *(each.at(0.0).type for each in segments)}  # a pause sends a position
        self._availability.require_topics(types, in_offboard=in_offboard)

    def _check_leader(self, follow: Follow) -> None:
        if follow.vehicle == self.vehicle.id:
            raise InvalidRequest("setpoint.vehicle", "A vehicle cannot follow itself.")
        self._find(follow.vehicle)
        leader = self._snapshots.leader(follow)
        if leader is None or (follow.offset_frd_m is not None and leader.yaw_ned_rad is None):
            raise Refused(
                f"Vehicle {follow.vehicle} is not connected, or has no valid global position.",
                remedy="A followed vehicle needs a global position that is at most a second old.",
            )


def _cannot_fly(error: ValueError) -> Refused:
    return Refused(
        f"The setpoint cannot be flown now: {error}.",
        remedy="Send another setpoint, or wait for the missing estimate.",
    )
