"""The event loop's side of one vehicle's stream: checks, starts, stops, and says how it stands."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from gcs_server.clock import Clock
from gcs_server.errors import GcsError, InvalidRequest, Refused, Rejected
from gcs_server.streamer.offboard.avoidance import AvoidanceControl
from gcs_server.streamer.offboard.configuration import OffboardConfiguration
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.streamer.offboard.failsafe import ACTION_MODES, Failsafe
from gcs_server.streamer.offboard.health import health_of
from gcs_server.streamer.offboard.operator_limits import VehicleOperatorLimits
from gcs_server.streamer.offboard.status import (
    FailsafeView,
    Limits,
    OffboardStatus,
    expiry_view,
    setpoint_view,
)
from gcs_server.streamer.schedule.streams import Streams
from gcs_server.streamer.validation.availability import Availability, Available
from gcs_server.streamer.validation.axes import problem_of
from gcs_server.streamer.validation.targets import check_segments, check_target
from gcs_server.streamer.values.bounds import UNBOUNDED, Bounds, bounds_of
from gcs_server.streamer.values.limit_values import vehicle_limits
from gcs_server.streamer.values.order import Order
from gcs_server.streamer.values.snapshot import Leader, Snapshot
from gcs_server.vehicle.vehicle import Vehicle
from missions.offboard.segments import Segment
from missions.runner.script import Script
from missions.setpoints import Follow

PRE_STREAM_S = 1.2
"""PX4 wants more than a second of setpoints before it takes Offboard."""
PRE_STREAM_WITHIN_S = 6.0
"""A machine too busy to send setpoints without a pause for so long cannot fly a vehicle."""
LOOK_EVERY_S = 0.02
"""Whether they have gone out so long is looked at so often, once they could have."""
ENDS_IN = {"to_hold": "hold", "undoing": "hold", "landing": "land"}
"""The mode that a stream asks for in each phase of its end."""
MESSAGE_OF_NO_STREAM = "There is no setpoint stream to this vehicle, so a setpoint has nowhere to go."
FindVehicle = Callable[[str], Vehicle]


class OffboardControl:
    """A vehicle's attribute `offboard`.

    Args:
        clock: the server's.
        vehicle: whose.
        streams: what sends.
        find: other vehicles by id, for following them; raises UnknownVehicle.
        limits: what the operator allows.
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
        self._availability = Availability(self._estimates, self._protocol)
        self._configuration = OffboardConfiguration(clock, vehicle, self._estimates)
        self.operator = limits
        self.avoidance = AvoidanceControl(clock, vehicle, self._estimates)
        self._bounds = UNBOUNDED
        self._bounds_of: tuple[object, ...] = ()
        self._asked = 0
        """The number of the stream for which Offboard has been asked for."""
        vehicle.command.on_mode_command = lambda: streams.inhibit_mode_requests(vehicle.id)
        identity = vehicle.identity
        streams.attach(vehicle.id, vehicle, (identity.system_id, identity.component_id))

    # --- the stream -------------------------------------------------------------------------------

    async def start(self, order: Order, rate_hz: float = 50.0) -> OffboardStatus:
        """Streams, asks for Offboard, and returns once the vehicle reports it; from any other mode.

        Where Offboard was asked for and its coming is in doubt (no answer, another command, the caller gone),
        the stream goes on for `UNDO_S` and puts the vehicle into Hold should it take Offboard yet.

        Raises:
            Refused: an estimate is missing, the target is too far, or somebody streams already.
            Rejected: the vehicle refused Offboard; the stream has been stopped.
        """
        vehicle = self.vehicle
        vehicle.require_commandable()
        vehicle.command.require_no_kill("start Offboard")
        status = vehicle.status
        if status.mode == "offboard" and status.armed and not self._streams.state(vehicle.id).order:
            raise Refused(
                f"Vehicle {vehicle.id} already flies Offboard by somebody else's setpoints.",
                remedy="Stop the other program, or command Hold first.",
            )
        await self.operator.recognised()
        if self.avoidance.way is not None:
            self.avoidance.require_sensor()
        self.check(order)
        await self._streams.ready()
        try:
            number = await self._streams.begin(vehicle.id, order, rate_hz, self.snapshot(order))
        except ValueError as error:
            raise _cannot_fly(error) from error
        if not number:
            raise Refused(
                f"Vehicle {vehicle.id} is streamed to already.",
                remedy="Send a setpoint to change the target, or stop the stream first.",
            )
        try:
            self._check_rate(await self._configuration.read(), rate_hz)
            await self._streamed_steadily(number)
            self.check(order)  # seconds may have passed, and the vehicle's limits are known now
            vehicle.command.require_no_kill("start Offboard")
            self._asked = number
            await vehicle.command.set_mode("offboard")
            if not await self._streams.engage(vehicle.id, self.snapshot(), number):
                self._still_starting(number)
            self.operator.tell_at_start()
        except BaseException as error:
            if self._asked == number and not isinstance(error, Rejected):
                self._streams.cancel_start(vehicle.id, self.snapshot(), number)
            else:
                reason = str(error) or "it was cancelled"
                self._streams.end(vehicle.id, "refused", f"Offboard did not start: {reason}", number)
            raise
        return self.status()

    async def _streamed_steadily(self, number: int) -> None:
        """Returns once setpoints have gone out without a pause for as long as the vehicle wants.

        Raises:
            Refused: they did not, or the stream has ended.
        """
        until_s = self._clock.monotonic_s() + PRE_STREAM_WITHIN_S
        while True:
            self._still_starting(number)
            short_s = PRE_STREAM_S - self._streams.state(self.vehicle.id).steady_s
            if short_s <= 0.0:
                return
            if self._clock.monotonic_s() >= until_s:
                raise Refused(
                    "Setpoints did not go out without a pause: the station's machine is too busy.",
                    remedy="Close what else runs on it, then start again.",
                )
            await self._clock.sleep(max(short_s, LOOK_EVERY_S))

    def _still_starting(self, number: int) -> None:
        if not self._streams.starting(self.vehicle.id, number):
            ended = self._streams.state(self.vehicle.id).last_end
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

    async def setpoint(self, order: Order) -> OffboardStatus:
        """A new target, handed to the stream before anything is waited for, and sent at once.

        Raises:
            Refused: no stream runs, it is a group's, an estimate is missing, or the target is too far.
        """
        self.vehicle.require_commandable()
        state = self._streams.state(self.vehicle.id)
        if state.phase == "idle":
            ended = f" It ended: {state.last_end.text}" if state.last_end else ""
            raise Refused(
                MESSAGE_OF_NO_STREAM + ended,
                remedy="Call offboard/start with a setpoint first; it streams, then switches to Offboard.",
            )
        if state.order is not None and state.order.owner == "mission" != order.owner:
            raise Refused(
                f"Vehicle {self.vehicle.id} flies the mission {state.order.client!r}.",
                remedy="Pause or abort the mission first (offboard_mission/pause, /abort), or command Hold.",
            )
        if state.order is not None and state.order.owner == "group" != order.owner:
            raise Refused(
                f"Vehicle {self.vehicle.id} flies in a group already.",
                remedy="Send the setpoint to the group (groups/{g}/setpoints), or hold the group first.",
            )
        self.check(order)
        try:
            taken = await self._streams.change(self.vehicle.id, order, self.snapshot(order))
        except ValueError as error:
            raise _cannot_fly(error) from error
        if not taken:
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
        vehicle = self.vehicle
        state = self._streams.state(vehicle.id)
        if state.phase in ("idle", "landing"):
            return self.status()
        self._streams.request_stop(vehicle.id, self.snapshot())
        await vehicle.command.kill_over()
        may_come = state.phase in ("starting", "undoing") and self._asked == state.number
        if may_come or vehicle.status.mode == "offboard":
            await vehicle.command.set_mode("hold")
        self._streams.end(vehicle.id, "stopped", "The stream was stopped.", state.number)
        return self.status()

    # --- what the vehicle is configured to ----------------------------------------------------------

    def asks_for(self) -> str | None:
        """The mode that the ending stream asks the vehicle for just now; None while it asks for none."""
        return ENDS_IN.get(self._streams.state(self.vehicle.id).phase)

    async def set_failsafe(self, action: str | None, after_s: float | None) -> FailsafeView:
        """Sets what the vehicle does by itself when the stream stops, each value verified.

        Raises:
            InvalidRequest: no such action.
            Refused: the stream that runs would be too slow for `after_s`.
            Rejected: the vehicle keeps another value.
        """
        if action is not None and action not in ACTION_MODES[:6]:
            raise InvalidRequest("action", f"There is no action {action!r}: {', '.join(ACTION_MODES[:6])}.")
        state = self._streams.state(self.vehicle.id)
        if after_s is not None and state.phase != "idle":
            self._check_rate(Failsafe(after_s, None, False), state.rate_hz)
        if after_s is not None:
            await self.vehicle.params.set("COM_OF_LOSS_T", after_s)
        if action is not None:
            await self.vehicle.params.set("COM_OBL_RC_ACT", ACTION_MODES.index(action))
        view = self._failsafe_view(await self._configuration.read())
        assert view is not None
        return view

    async def ensure_parameters(self) -> None:
        """Asks the vehicle for what is not known of its configuration and can be."""
        await self._configuration.ensure()

    # --- what can be read ---------------------------------------------------------------------------

    def available(self) -> dict[str, Available]:
        """Which types of setpoint it can be flown by now, and why not by the rest."""
        return self._availability.all()

    def limits(self) -> Limits:
        """What setpoints are held to."""
        return Limits(
            vehicle_limits(self._configuration.parameters()), self.operator.limits, self.operator.origin()
        )

    def failsafe(self) -> FailsafeView | None:
        """What the vehicle does by itself when the stream stops; None before it told."""
        return self._failsafe_view(self._configuration.failsafe())

    @staticmethod
    def _failsafe_view(failsafe: Failsafe | None) -> FailsafeView | None:
        if failsafe is None:
            return None
        return FailsafeView(
            failsafe.loss_timeout_s, failsafe.action_mode, failsafe.transmitter, failsafe.words()
        )

    def status(self) -> OffboardStatus:
        """How the stream stands, now."""
        state = self._streams.state(self.vehicle.id)
        order, failsafe = state.order, self._configuration.failsafe()
        return OffboardStatus(
            streaming=state.phase != "idle",
            state=state.phase,
            client=order.client if order else None,
            client_key=(order.client_key or None) if order else None,
            owner=order.owner if order else None,
            ordered_type=order.setpoint.type if order else None,
            setpoint=setpoint_view(state.sent),
            limited=state.limited,
            rate_hz=state.rate_hz,
            rate_achieved_hz=state.rate_achieved_hz,
            age_s=state.age_s,
            valid_for_s=order.valid_for_s if order else None,
            valid_left_s=state.valid_left_s,
            on_expiry=expiry_view(order.on_expiry) if order else None,
            if_stream_stops=failsafe.words() if failsafe else None,
            sends_failed=state.sends_failed,
            ended=state.last_end.text if state.last_end and state.phase == "idle" else None,
            limits_origin=self.operator.origin(),
            avoidance=self.avoidance.view(state),
            health=health_of(state, self._estimates, failsafe),
        )

    def snapshot(self, order: Order | None = None) -> Snapshot:
        """The vehicle as its stream is to know it (for an order that is about to be taken)."""
        order = order or self._streams.state(self.vehicle.id).order
        attitude = self._estimates.attitude()
        return self._estimates.snapshot(
            q_ned_frd=None if attitude is None else attitude.q_ned_frd,
            bounds=self._current_bounds(),
            hover_thrust=self._configuration.parameters().get("MPC_THR_HOVER"),
            leader=self._leader(order.setpoint) if order and isinstance(order.setpoint, Follow) else None,
            avoidance=self.avoidance.way,
            mission_avoidance=self.avoidance.mission_way,
        )

    def snapshot_without_estimates(self) -> Snapshot:
        """What its heartbeat says, and the limits as they were: where nothing else can be made of it."""
        vehicle, status = self.vehicle, self.vehicle.status
        return Snapshot(
            self._clock.monotonic_s(),
            status.mode,
            None,
            None,
            None,
            armed=status.armed,
            lost=status.link_lost or not vehicle.endpoints,
            bounds=self._bounds,
        )

    # --- inside -------------------------------------------------------------------------------------

    def _protocol(self) -> str:
        endpoints = self.vehicle.endpoints
        return endpoints[0].connection.protocol if endpoints else "MAVLink"

    def _current_bounds(self) -> Bounds:
        """Made anew only where their sources have changed: its stream is told of it then."""
        made_of = (
            self._configuration.parameters(),
            self.operator.limits,
            self._estimates.home(),
            self._estimates.origin(),
        )
        if made_of != self._bounds_of:
            parameters, operator, home, origin = made_of
            gains = (parameters.get("MPC_XY_P"), parameters.get("MPC_Z_P"))
            self._bounds = bounds_of(vehicle_limits(parameters), operator, home, origin, gains)
            self._bounds_of = made_of
        return self._bounds

    def _leader(self, follow: Follow) -> Leader | None:
        try:
            leader = self._find(follow.vehicle)
        except GcsError:
            return None
        return VehicleEstimates(leader).as_leader(self._estimates.origin())

    def check(self, order: Order) -> None:
        """Raises Refused where the order cannot be flown now, InvalidRequest where it never can."""
        setpoint = order.setpoint
        if isinstance(setpoint, Script):
            self._availability.require_estimates(setpoint.type, setpoint.needs)
            self.check_segments([s for s in (setpoint.approach, *setpoint.segments) if s is not None])
            return
        problem = problem_of(setpoint)
        if problem is not None:
            raise InvalidRequest("setpoint", problem)
        self._availability.require(setpoint)
        if isinstance(setpoint, Follow):
            self._check_leader(setpoint)
        check_target(
            setpoint,
            self._clock.monotonic_s(),
            self.snapshot(order),
            limited_place=self.operator.limits.bounds_a_place,
        )

    def check_segments(self, segments: Sequence[Segment]) -> None:
        """Raises Refused where these of a mission leave the limits of place."""
        limited = self.operator.limits.bounds_a_place
        check_segments(segments, self.snapshot(), limited_place=limited)

    def _check_leader(self, follow: Follow) -> None:
        if follow.vehicle == self.vehicle.id:
            raise InvalidRequest("vehicle", "A vehicle cannot follow itself.")
        self._find(follow.vehicle)
        leader = self._leader(follow)
        if leader is None or (follow.offset_frd_m is not None and leader.yaw_ned_rad is None):
            raise Refused(
                f"Vehicle {follow.vehicle} is not connected, or has no valid global position.",
                remedy="It needs a global position, fresh within a second, to be followed.",
            )


def _cannot_fly(error: ValueError) -> Refused:
    return Refused(
        f"The setpoint cannot be flown now: {error}.", remedy="Send another, or wait for what is missing."
    )
