"""Commands to a vehicle; each succeeds when the vehicle's own state shows the result.

Deadlines are sufficient at 20 % loss each way: arm, disarm and modes 6 s, take-off 20 s, go-to 6 s. Every
repeated message requests a state or names a target, so a second copy has no effect. Each command holds a
ticket (`tickets.py`), which a later command cancels; its messages are then no longer sent. Only Stop motors
(`stop_motors.py`) cannot be ended.

Where arming would start a flight (`hold_disarmed.py`), `arm` alone is refused unless the caller accepts the
flight.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from typing import TypedDict, Unpack

from gcs_server.errors import (
    Disconnected,
    InvalidRequest,
    NoReply,
    PlanFindings,
    Refused,
    Rejected,
)
from gcs_server.mavlink import dialect as d
from gcs_server.vehicle.px4.modes import BY_CUSTOM_MODE, BY_NAME, Mode
from gcs_server.vehicle.reducers import FlightState
from gcs_server.vehicle.services import checks
from gcs_server.vehicle.services.checks import VehicleFloor
from gcs_server.vehicle.services.hold_disarmed import HoldDisarmed
from gcs_server.vehicle.services.port import VehiclePort
from gcs_server.vehicle.services.stop_motors import StopMotors
from gcs_server.vehicle.services.transaction import Goal, ReportProgress, Request, Transaction
from gcs_server.vehicle.tickets import Ticket

TAKEOFF_MIN_M, TAKEOFF_MAX_M = 1.0, 120.0
STATE_DEADLINE_S = 6.0
LIFT_OFF_DEADLINE_S = 12.0
HOME_DEADLINE_S = MODE_LIST_DEADLINE_S = 3.0
MAX_MODE_DELAY_S = STATE_DEADLINE_S + HOME_DEADLINE_S
"""Maximum time between a command and its mode change [s]."""
NAN = math.nan
AIRBORNE = ("in_air", "taking_off", "landing")
ARMING_STARTS_FLIGHT = "arming_starts_flight"
"""Code of the finding that arming starts a flight, which `arm` must accept."""
MISSION_REFUSED_WITHIN_S = 2.0
"""A refusal of Mission within this time after an upload, and the wait that follows it, is not final [s]."""


@dataclass(frozen=True, slots=True)
class ModeCommand:
    """This server's newest command that changes the mode. A change to this mode within
    `MAX_MODE_DELAY_S` counts as the command's result."""

    label: str
    """Label of the command for messages."""
    mode: str
    """The requested mode, as in `Status.mode`."""
    by: str | None
    """The client that sent the command."""
    since_s: float
    """Monotonic time of the command."""


class CommandOptions(TypedDict, total=False):
    """What every command takes, all of it optional."""

    by: str | None
    """The client."""
    progress: ReportProgress | None
    """Called with each step."""
    ticket: Ticket | None
    """The ticket of the accepted command; None: the method opens and claims its own."""
    on_lost_link: bool
    """For Hold, Land and RTL: the command is also sent, and sent again until its deadline, while nothing is
    received from the vehicle: a radio can fail in one direction only."""


class CommandService:
    """Arm, modes, take-off. The commands in flight are in `guided.py`.

    Every method may raise Refused or NotVerified (nothing was sent), InvalidRequest (an invalid value),
    Rejected (with the vehicle's reasons), NoReply (at the deadline), Disconnected (the vehicle or its link
    was lost), or Interrupted (its ticket was cancelled).
    """

    def __init__(
        self, vehicle: VehiclePort, floor: VehicleFloor, mission_startable_s: Callable[[], float]
    ) -> None:
        """
        Args:
            vehicle: the vehicle.
            floor: the lowest altitudes for targets.
            mission_startable_s: the monotonic time from which PX4 starts the last uploaded mission [s].
        """
        self._vehicle = vehicle
        self._mission_startable_s = mission_startable_s
        self.floor = floor
        """The lowest altitudes for targets."""
        self._newest_command: ModeCommand | None = None
        self.on_mode_command: Callable[[], object] = lambda: None
        """Called before a mode other than Offboard is requested, so that the setpoint stream requests no mode
        meanwhile."""
        self._stop_motors = StopMotors(vehicle)
        self._disarmed = HoldDisarmed(
            vehicle, self._commanded_mode, lambda: self._stop_motors.pending, lambda: self.hold()
        )
        self._running_commands: list[int] = []
        """MAV_CMD of each running request."""

    @property
    def newest_command(self) -> ModeCommand | None:
        """This server's newest command that changes the mode; None: there was none."""
        return self._newest_command

    def recent_command(self, mode: str) -> ModeCommand | None:
        """This server's command that may have caused this mode; None: no recent command."""
        newest = self._newest_command
        if newest is None or newest.mode != mode:
            return None
        return newest if self._vehicle.clock.monotonic_s() - newest.since_s <= MAX_MODE_DELAY_S else None

    def _commanded_mode(self) -> str | None:
        """The mode that this server has just requested; None: no recent request."""
        newest = self._newest_command
        return newest.mode if newest is not None and self.recent_command(newest.mode) is not None else None

    def record_executor_request(self, label: str, mode: str, by: str) -> None:
        """Records that the executor of an external mode requests this mode; raises Refused during Stop
        motors."""
        self.require_no_kill(label)
        self._newest_command = ModeCommand(label, mode, by, self._vehicle.clock.monotonic_s())
        self.on_mode_command()

    async def arm(self, *, starts_flight: bool = False, **options: Unpack[CommandOptions]) -> None:
        """Arms; returns once the vehicle reports that it is armed.

        Args:
            starts_flight: the caller accepts that arming starts a flight.
            options: see `CommandOptions`.

        Raises:
            PlanFindings: arming would start a flight, which the caller does not accept.
        """
        self._vehicle.require_commandable()
        if not starts_flight and (text := self._disarmed.flight_when_armed()) is not None:
            raise PlanFindings(
                text,
                codes=(ARMING_STARTS_FLIGHT,),
                remedy="Select Hold first; or accept the flight by naming arming_starts_flight in `despite`.",
            )
        with self.begin("arm", options) as ticket:
            if not starts_flight:
                ticket.add_condition(self._disarmed.flight_when_armed)
            await self._arm(ticket, options)

    async def disarm(self, **options: Unpack[CommandOptions]) -> None:
        """Disarms (on the ground); returns once the vehicle reports that it is disarmed."""
        self._vehicle.require_commandable()
        goal = Goal(
            "disarm",
            lambda f, s: f.heartbeat_s > s and not f.armed,
            STATE_DEADLINE_S,
            requested_ids=REQUEST_HEARTBEAT,
        )
        with self.begin("disarm", options) as ticket:
            await self.run(ticket, _arm_disarm(0.0, 0.0), goal, options)
        self._disarmed.hold_after_disarming()

    async def set_mode(
        self,
        name: str,
        **options: Unpack[CommandOptions],
    ) -> None:
        """Changes to the mode `name` (as in `Status.mode`); returns once the vehicle reports the mode."""
        mode = BY_NAME.get(name)
        if mode is not None and mode.by_announcement:
            self._vehicle.require_commandable()
            await self._require_announced(mode)
        elif mode is None or not mode.settable:
            names = ", ".join(m.name for m in BY_NAME.values() if m.settable)
            raise InvalidRequest("mode", f"There is no mode {name!r} to set.", remedy=f"Modes: {names}.")
        self._vehicle.require_commandable()
        label = f"mode {self._vehicle.mode_names.label(mode)}"
        with self.begin(label, options, mode) as ticket:
            await self.enter_mode(ticket, mode, options)

    async def takeoff(
        self,
        alt_home_m: float,
        **options: Unpack[CommandOptions],
    ) -> None:
        """Arms if needed and takes off; returns once the vehicle is taking off, before it reaches the
        altitude."""
        checks.check_range("alt_home_m", alt_home_m, TAKEOFF_MIN_M, TAKEOFF_MAX_M)
        vehicle = self._vehicle
        vehicle.require_commandable()
        if vehicle.flight_state.armed and vehicle.flight_state.landed_state in AIRBORNE:
            raise Refused(
                f"Vehicle {vehicle.id} is already flying.", remedy="Use go-to for another altitude."
            )
        checks.position_of(vehicle)
        with self.begin("take off", options, BY_NAME["takeoff"]) as ticket:
            alt_amsl_m = checks.require_climb(vehicle, alt_home_m, await self.home_alt_amsl_m(ticket))
            request = Request(d.MAV_CMD_NAV_TAKEOFF, (-1.0, 0.0, 0.0, NAN, NAN, NAN, alt_amsl_m))
            async with self._disarmed.hold_unless_armed(ticket, BY_NAME["takeoff"]):
                in_takeoff = Goal("take off", in_mode(BY_NAME["takeoff"]), STATE_DEADLINE_S)
                await self.run(ticket, request, in_takeoff, options)
                if not vehicle.flight_state.armed:
                    await self._arm(ticket, options)
                    # sent again, because a disarmed PX4 may drop the altitude
                    again = Goal(
                        "take off to that altitude",
                        _never,
                        STATE_DEADLINE_S,
                        requested_ids=(),
                        ack_is_enough=True,
                    )
                    await self.run(ticket, request, again, options)
            lifted = Goal(
                "take off",
                lambda f, _: f.armed and f.landed_state in ("taking_off", "in_air"),
                LIFT_OFF_DEADLINE_S,
                requested_ids=(d.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,),
            )
            if (progress := options.get("progress")) is not None:
                progress("Armed, waiting for lift-off", None)
            await self.run(ticket, None, lifted, options)

    async def start_mission(
        self,
        **options: Unpack[CommandOptions],
    ) -> None:
        """Starts the vehicle's mission at its current item; arms if needed.

        Returns once the vehicle is armed in Mission. Both requests name a state; a repetition has no effect.
        """
        mission = BY_NAME["mission"]
        self._vehicle.require_commandable()
        with self.begin("start the mission", options, mission) as ticket:
            async with self._disarmed.hold_unless_armed(ticket, mission):
                await self.enter_mode(ticket, mission, options)
                if not self._vehicle.flight_state.armed:
                    await self._arm(ticket, options)

    async def land(
        self,
        **options: Unpack[CommandOptions],
    ) -> None:
        """Lands at the current position; returns once the vehicle is landing, or has landed and disarmed."""
        await self._switch(BY_NAME["land"].label, "land", options, or_disarmed=True)

    async def rtl(self, **options: Unpack[CommandOptions]) -> None:
        """Returns to the launch position and lands, as the vehicle's own RTL does."""
        await self._switch(BY_NAME["rtl"].label, "rtl", options, or_disarmed=True)

    async def hold(self, **options: Unpack[CommandOptions]) -> None:
        """Switches to Hold: the vehicle stops and keeps its position."""
        await self._switch("hold", "hold", options)

    async def kill(
        self,
        **options: Unpack[CommandOptions],
    ) -> None:
        """Stops the motors immediately, even in flight: the vehicle falls. Ends every waiting command, and
        refuses all other commands until it has ended. Returns once the vehicle reports that it is disarmed.
        The command is repeated until then or the deadline, even if the vehicle refuses or the link is lost.
        """
        with suppress(Disconnected):  # also sent on a lost link
            self._vehicle.require_commandable()
        arming = d.MAV_CMD_COMPONENT_ARM_DISARM in self._running_commands
        own = options.get("ticket") or self._vehicle.tickets.open("stop motors")
        own.claim()
        own.close()  # from now on, `require_no_kill` refuses other commands
        self.on_mode_command()
        await self._stop_motors.run(
            by=options.get("by"),
            arming=arming,
            progress=options.get("progress"),
            on_disarmed=self._disarmed.hold_after_disarming,
        )

    def require_no_kill(self, label: str) -> None:
        """Raises Refused for the command `label` while Stop motors is not confirmed."""
        self._stop_motors.require_none(label)

    async def wait_for_kill(self) -> None:
        """Returns once no Stop motors command is waiting for confirmation."""
        await self._stop_motors.wait()

    # --- internal -------------------------------------------------------------------------------

    async def _switch(
        self, label: str, mode_name: str, options: CommandOptions, *, or_disarmed: bool = False
    ) -> None:
        self._vehicle.require_commandable(on_lost_link=options.get("on_lost_link", False))
        mode = BY_NAME[mode_name]
        with self.begin(label, options, mode) as ticket:
            await self.enter_mode(ticket, mode, options, or_disarmed=or_disarmed)

    async def _arm(self, ticket: Ticket, options: CommandOptions) -> None:
        goal = Goal(
            "arm",
            lambda f, s: f.heartbeat_s > s and f.armed,
            STATE_DEADLINE_S,
            requested_ids=REQUEST_HEARTBEAT,
            present_problems=self._arming_problems,
        )
        await self.run(ticket, _arm_disarm(1.0, 0.0), goal, options)

    async def enter_mode(
        self,
        ticket: Ticket,
        mode: Mode,
        options: CommandOptions,
        *,
        or_disarmed: bool = False,
    ) -> None:
        """Changes to a mode, as a part of a command. With `or_disarmed`, an armed vehicle that disarms has
        reached the goal too."""
        is_in_mode, was_armed = in_mode(mode), self._vehicle.flight_state.armed

        def reached(flight_state: FlightState, since_s: float) -> bool:
            has_disarmed = was_armed and flight_state.heartbeat_s > since_s and not flight_state.armed
            return is_in_mode(flight_state, since_s) or (or_disarmed and has_disarmed)

        request = Request(
            d.MAV_CMD_DO_SET_MODE,
            (float(d.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED), float(mode.main), float(mode.sub), 0, 0, 0, 0),
        )
        label = f"switch to {self._vehicle.mode_names.label(mode)}"
        on_lost_link = options.get("on_lost_link", False)
        goal = Goal(label, reached, STATE_DEADLINE_S, on_lost_link=on_lost_link)
        if mode.name == "mission":
            await self._run_once_startable(ticket, request, goal, options)
        else:
            await self.run(ticket, request, goal, options)

    async def _run_once_startable(
        self, ticket: Ticket, request: Request, goal: Goal, options: CommandOptions
    ) -> None:
        """Requests Mission once PX4 starts the last uploaded mission. PX4 may need longer when it is busy:
        then a refusal is requested again."""
        clock = self._vehicle.clock
        while True:
            startable_s = self._mission_startable_s()
            await clock.sleep(max(0.0, startable_s - clock.monotonic_s()))
            try:
                await self.run(ticket, request, goal, options)
                return
            except Rejected:
                if clock.monotonic_s() >= startable_s + MISSION_REFUSED_WITHIN_S:
                    raise

    async def _require_announced(self, mode: Mode) -> None:
        """Requests the vehicle's list of modes, and raises Refused if it does not have this one."""
        vehicle = self._vehicle
        ids = (d.MAVLINK_MSG_ID_AVAILABLE_MODES,)
        goal = Goal(
            "announce its modes",
            lambda _f, _s: mode.name in vehicle.mode_names.selectable,
            MODE_LIST_DEADLINE_S,
            requested_ids=ids,
            listen=ids,
        )
        if mode.name not in vehicle.mode_names.selectable:
            with suppress(NoReply, Rejected), closing(vehicle.tickets.open("the list of modes")) as ticket:
                await self.run(ticket, None, goal, {})
        if mode.name not in vehicle.mode_names.selectable:
            raise Refused(
                f"Vehicle {vehicle.id} does not announce the mode {mode.label}, which PX4 has from v1.17 on.",
                remedy="Use Altitude or Position instead.",
            )

    async def home_alt_amsl_m(self, ticket: Ticket) -> float:
        """Altitude of home [m]."""
        await self.request_home(ticket)
        return checks.home_of(self._vehicle).alt_amsl_m

    async def request_home(self, ticket: Ticket) -> None:
        """Requests an unknown home, because PX4 sends it only every two seconds."""
        vehicle = self._vehicle
        if vehicle.topic("home") is None:
            home = (d.MAVLINK_MSG_ID_HOME_POSITION,)
            goal = Goal(
                "report its home position",
                lambda _f, _s: vehicle.topic("home") is not None,
                HOME_DEADLINE_S,
                requested_ids=home,
                listen=home,
            )
            with suppress(NoReply):
                await self.run(ticket, None, goal, {})

    def _arming_problems(self) -> tuple[str, ...]:
        mode = BY_CUSTOM_MODE.get(self._vehicle.flight_state.custom_mode)
        return self._vehicle.health.arming_problems(mode.nav_state if mode else None)

    @contextmanager
    def begin(self, label: str, options: CommandOptions, mode: Mode | None = None) -> Generator[Ticket]:
        """The block of a command: its ticket, which has cancelled those of earlier commands."""
        self.require_no_kill(label)
        ticket = options.get("ticket")
        own = ticket or self._vehicle.tickets.open(label)
        try:
            own.claim()
            if mode is not None:
                now_s = self._vehicle.clock.monotonic_s()
                self._newest_command = ModeCommand(label, mode.name, options.get("by"), now_s)
                if mode.name != "offboard":
                    self.on_mode_command()
            yield own
        finally:
            if ticket is None:
                own.close()

    async def run(self, ticket: Ticket, request: Request | None, goal: Goal, options: CommandOptions) -> None:
        progress = options.get("progress")
        if request is None:
            await Transaction(self._vehicle, None, goal, progress, ticket).run()
            return
        replaces_request = request.command in self._running_commands
        self._running_commands.append(request.command)
        try:
            await Transaction(self._vehicle, request, goal, progress, ticket, replaces_request).run()
        finally:
            self._running_commands.remove(request.command)


REQUEST_HEARTBEAT = (d.MAVLINK_MSG_ID_HEARTBEAT,)


def _arm_disarm(arm: float, force: float) -> Request:
    return Request(d.MAV_CMD_COMPONENT_ARM_DISARM, (arm, force, 0, 0, 0, 0, 0))


def in_mode(mode: Mode) -> Callable[[FlightState, float], bool]:
    return lambda flight_state, since_s: (
        flight_state.mode_s > since_s and flight_state.custom_mode == mode.custom_mode
    )


def _never(_flight_state: FlightState, _since_s: float) -> bool:
    """A condition for commands whose only result is the acknowledgement."""
    return False
