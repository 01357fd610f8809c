"""Offboard missions that are registered with PX4 as flight modes.

Every ground station and the transmitter can then select the mission by its name. PX4 decides when the mode
is active; this module only reacts: it starts the mission when the vehicle is in the mode, and resumes it when
the vehicle is in the mode again. It never requests the mode by itself.

A mission that begins with a take-off has a mode with an executor: the vehicle is armed in the mode, and the
mission then begins on the ground. The mission is compiled before arming (`preparation.py`).
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable, Mapping
from contextlib import closing
from dataclasses import dataclass, field, replace
from typing import Final

from gcs_server.clock import Clock
from gcs_server.errors import GcsError, Interrupted, Refused, UnknownVehicle
from gcs_server.flights.mission_values import MissionAsMode, MissionModeStatus, Start
from gcs_server.flights.missions import OffboardMissions
from gcs_server.flights.preparation import (
    NOTICE,
    WARNING,
    Preparation,
    Preparer,
    add_event,
    with_remedy,
)
from gcs_server.links.base import DdsAddress
from gcs_server.ros2.external_mode import (
    REPLIES_ENDED,
    ModeDeclaration,
    Registration,
    RegistrationState,
)
from gcs_server.ros2.formats import with_formats_of
from gcs_server.streamer.offboard.streamer import Streamer
from gcs_server.streamer.process.streams import Streams
from gcs_server.streamer.schedule.external_modes import READ_TYPES, WRITTEN, topics_for
from gcs_server.streamer.validation import require_usable
from gcs_server.streamer.values.stream_request import OFFBOARD
from gcs_server.supervise import Supervisor
from gcs_server.vehicle.endpoint import dds_address, unusable_topics
from gcs_server.vehicle.services.transaction import ReportProgress
from gcs_server.vehicle.settling import settled
from gcs_server.vehicle.tickets import Ticket
from gcs_server.vehicle.vehicle import Vehicle
from missions.setpoints import Estimate

log = logging.getLogger(__name__)
UPDATE_PERIOD_S: Final = 0.1
REGISTER_TIMEOUT_S: Final = 16.0
"""DDS needs up to a few seconds to connect; then the registration is requested up to five times, once a
second."""
ALWAYS_REQUIRED: Final = frozenset({"angular_velocity", "attitude", "local_alt", "local_position"})
"""Mode requirements of PX4 that the setpoints of every mission have."""
REQUIREMENT_OF: Final[Mapping[Estimate, str]] = {
    "global_position": "global_position",
    "home": "home_position",
}
IN_CHARGE_TIMEOUT_S: Final = 1.0
"""Time within which PX4 reports that the executor of the selected mode is in charge."""
AFTER_DISARMING_S: Final = 3.0
"""Time after disarming within which PX4 may select an executor's mode again, as after a landing [s]."""


@dataclass(slots=True)
class _ModeEntry:
    mode: MissionAsMode
    state: RegistrationState = "registering"
    failsafe_deferred: bool = False
    preparation: Preparation | None = None
    """The mission, compiled before arming; None: the mission begins in the air, and is compiled when it
    begins."""


@dataclass(slots=True)
class _VehicleModes:
    vehicle: Vehicle
    modes: dict[str, _ModeEntry] = field(default_factory=dict[str, _ModeEntry])
    last_mode: tuple[str, float] | None = None
    """Mode of the armed vehicle at the last update, and when the vehicle entered it [s since 1970]. The
    vehicle may leave a mode and enter it again between two updates."""
    disarmed_s: float = float("-inf")
    """When the vehicle was disarmed [s, monotonic]; -inf once the server has selected Hold."""


class MissionModes:
    """The mission modes of all vehicles.

    Args:
        clock: the server's clock.
        streamer: the setpoint control of all vehicles.
        streams: registers the modes.
        missions: flies the missions.
        supervisor: runs background tasks.
        preparer: compiles the missions of modes, and checks them.
    """

    def __init__(
        self,
        clock: Clock,
        streamer: Streamer,
        streams: Streams,
        missions: OffboardMissions,
        supervisor: Supervisor,
        preparer: Preparer,
    ) -> None:
        self._clock, self._streamer, self._streams = clock, streamer, streams
        self._missions, self._supervisor = missions, supervisor
        self._preparer = preparer
        self._vehicles: dict[str, _VehicleModes] = {}

    def start(self) -> None:
        """Starts the periodic update."""
        self._supervisor.repeat("mission-modes", self.update, UPDATE_PERIOD_S)

    def detach(self, vehicle: Vehicle) -> None:
        """Drops the modes of a removed vehicle."""
        self._vehicles.pop(vehicle.id, None)

    # --- requests of clients ----------------------------------------------------------------------

    async def register(
        self,
        vehicle_id: str,
        mode: MissionAsMode,
        require_permission: Callable[[], None] = lambda: None,
        progress: ReportProgress | None = None,
    ) -> MissionModeStatus:
        """Registers a mission as a mode; returns when PX4 has accepted it. A cancelled call removes the mode.

        Args:
            vehicle_id: the vehicle.
            mode: the mission.
            require_permission: raises an error if the client must not register the mode any more; called
                after the waiting and the compilation, directly before PX4 is asked.
            progress: reports what a vehicle that has just connected has not reported yet.

        Raises:
            PlanFindings: the mission has error findings that the client does not accept.
            Refused: the vehicle has no ROS 2 connection, PX4 refuses the mode or does not answer, the
                vehicle has a mode of this name, or the mission cannot be compiled.
        """
        vehicle = self._vehicle(vehicle_id)
        vehicle.require_commandable()
        _ros2_address(vehicle)
        inputs = self._preparer.inputs(vehicle_id)
        start = await self._preparer.prepare(vehicle_id, mode)
        needs = {REQUIREMENT_OF[need] for need in start.timeline.needs if need in REQUIREMENT_OF}
        try:
            declaration = ModeDeclaration(
                mode.name, ALWAYS_REQUIRED | needs, mode.defer_failsafes_s, mode.takes_off
            )
        except ValueError as error:
            raise _cannot_register(vehicle_id, error) from None
        offboard = self._streamer.offboard(vehicle_id)

        def address_with_topics() -> DdsAddress:
            offboard.require_topics(start.timeline.segments, in_offboard=False)
            _require_topics(vehicle, topics_for(declaration))
            return _ros2_address(vehicle)  # with the layouts that PX4 has confirmed by now

        address = await settled(vehicle, address_with_topics, progress=progress)
        require_permission()
        entry = _ModeEntry(mode, preparation=Preparation(start, inputs) if mode.takes_off else None)
        registration = await self._register(vehicle, address, declaration, entry)
        self.update()
        return self._status(entry, registration)

    async def _register(
        self, vehicle: Vehicle, address: DdsAddress, declaration: ModeDeclaration, entry: _ModeEntry
    ) -> Registration:
        """Registers a mode, and returns once PX4 has accepted it; otherwise removes the mode."""
        name = declaration.name
        try:
            mode_address = with_formats_of(address, {*WRITTEN, *READ_TYPES})
            await self._streams.register_mode(vehicle.id, mode_address, declaration)
        except ValueError as error:
            raise _cannot_register(vehicle.id, error) from None
        except asyncio.CancelledError:
            self._streams.unregister_mode(vehicle.id, name)
            raise
        self._require_attached(vehicle, name)
        self._vehicles.setdefault(vehicle.id, _VehicleModes(vehicle)).modes[name] = entry
        until_s = self._clock.monotonic_s() + REGISTER_TIMEOUT_S
        try:
            while (registration := self._registration(vehicle.id, name)).state == "registering":
                if self._clock.monotonic_s() >= until_s:
                    break
                await self._clock.sleep(UPDATE_PERIOD_S / 2)
        except asyncio.CancelledError:
            self._drop(vehicle.id, name)
            raise
        if registration.state != "registered":
            self._drop(vehicle.id, name)
            raise Refused(
                f"The mode {name!r} was not registered: {registration.reason or 'PX4 did not answer'}.",
                remedy="Check the ros2:// link, and that the vehicle is disarmed; then try again.",
            )
        return registration

    def unregister(self, vehicle_id: str, name: str) -> None:
        """Removes a mode from PX4.

        Raises:
            Refused: there is no such mode, or the vehicle flies in it.
        """
        vehicle = self._vehicle(vehicle_id)
        state = self._vehicles.get(vehicle_id)
        if state is None or name not in state.modes:
            names = ", ".join(map(repr, state.modes)) if state is not None and state.modes else "none"
            raise Refused(
                f"Vehicle {vehicle_id} has no mode {name!r} of this server.", remedy=f"Its modes: {names}."
            )
        mode = self._registration(vehicle_id, name).mode
        flight = None if mode is None else self._missions.flown_in(vehicle_id, mode)
        is_flown = vehicle.status.mode == mode or (flight is not None and flight.runner.in_charge)
        if mode is not None and vehicle.status.armed and is_flown:
            raise Refused(
                f"Vehicle {vehicle_id} flies in the mode {name!r}; without this mode, PX4 would return (RTL) "
                "at once.",
                remedy="Command Hold or another mode first.",
            )
        self._drop(vehicle_id, name)

    def all(self, vehicle_id: str) -> list[MissionModeStatus]:
        """The modes of a vehicle."""
        state = self._vehicles.get(vehicle_id)
        return [
            self._status(entry, self._registration(vehicle_id, name))
            for name, entry in ({} if state is None else state.modes).items()
        ]

    # --- time -------------------------------------------------------------------------------------

    def update(self) -> None:
        """Reports changes, and starts the mission of a mode that has become active."""
        for state in list(self._vehicles.values()):
            state.vehicle.isolation.run("its mission modes", self._update_vehicle, state.vehicle, state)

    def _update_vehicle(self, vehicle: Vehicle, state: _VehicleModes) -> None:
        by_mode: dict[str, _ModeEntry] = {}
        for name, entry in state.modes.items():
            registration = self._registration(vehicle.id, name)
            if registration.mode is not None:
                by_mode[registration.mode] = entry
                vehicle.mode_names.external[registration.mode] = name
            if registration.state != entry.state:
                entry.state = registration.state
                self._report(vehicle, name, registration)
            if registration.failsafe_deferred != entry.failsafe_deferred:
                entry.failsafe_deferred = registration.failsafe_deferred
                self._report_deferral(vehicle, entry)
        self._forget_names(vehicle, by_mode)
        status = vehicle.status
        if status.link_lost:
            return
        if not status.armed:
            prepared = [(entry.mode, entry.preparation) for entry in by_mode.values()]
            self._preparer.update(
                vehicle, [(mode, preparation) for mode, preparation in prepared if preparation is not None]
            )
        since_s = 0.0 if vehicle.mode_cause is None else vehicle.mode_cause.since_unix_s
        last_mode, state.last_mode = state.last_mode, (status.mode, since_s) if status.armed else None
        if last_mode is not None and not status.armed:
            state.disarmed_s = self._clock.monotonic_s()
        self._hold_after_disarming(vehicle, state, by_mode)
        entered = by_mode.get(status.mode) if state.last_mode != last_mode and status.armed else None
        if entered is not None:
            ticket = vehicle.tickets.open(f"mode {entered.mode.name}", yields=True)
            work = self._begin(vehicle, status.mode, entered, ticket)
            self._supervisor.spawn(f"vehicle {vehicle.id}: mission mode", work)

    def _hold_after_disarming(
        self, vehicle: Vehicle, state: _VehicleModes, by_mode: Mapping[str, _ModeEntry]
    ) -> None:
        """Selects Hold if PX4, after disarming, has returned to a mission mode with an executor or to
        Takeoff, which such a mission uses. In these modes the next arming would start a take-off."""
        mode = vehicle.status.mode
        if mode == "takeoff" and (flown := self._missions.status(vehicle.id)) is not None:
            mode = flown.mode
        entry = by_mode.get(mode)
        if entry is None or not entry.mode.takes_off or vehicle.status.armed:
            return
        mission_mode = entry.mode
        if self._clock.monotonic_s() - state.disarmed_s > AFTER_DISARMING_S:
            return
        state.disarmed_s = float("-inf")

        async def hold() -> None:
            try:
                await vehicle.command.hold(by=f"The mode {mission_mode.name!r}")
            except GcsError as error:
                text = (
                    f"After the mission of the mode {mission_mode.name!r} the vehicle did not switch to "
                    f"Hold: {error} Select another mode before you arm, or it takes off again."
                )
                add_event(vehicle, self._clock, mission_mode.name, "still_selected", text, WARNING)

        self._supervisor.spawn(f"vehicle {vehicle.id}: mission mode", hold())

    @staticmethod
    def _forget_names(vehicle: Vehicle, registered: Mapping[str, _ModeEntry]) -> None:
        """Drops the names of modes that PX4 no longer has, once the vehicle has left them."""
        names = vehicle.mode_names.external
        for mode in [mode for mode in names if mode not in registered and mode != vehicle.status.mode]:
            del names[mode]

    def _report(self, vehicle: Vehicle, name: str, registration: Registration) -> None:
        if registration.state == "registered":
            takes_off = self._vehicles[vehicle.id].modes[name].mode.takes_off
            when = "on the ground, and starts when the vehicle is armed" if takes_off else "in the air"
            text = f"PX4 shows the mission as the mode {name!r}; it can be selected {when}."
            add_event(vehicle, self._clock, name, "registered", text, NOTICE)
        elif registration.state == "lost":
            text = f"The mode {name!r} is no longer registered: {registration.reason}."
            if vehicle.status.armed and vehicle.mode_names.external.get(vehicle.status.mode) == name:
                text = f"{text} PX4 returns (RTL) unless another mode is commanded within about 1 s."
            add_event(vehicle, self._clock, name, "lost", f"{text} Register it again to use it.", WARNING)

    def _report_deferral(self, vehicle: Vehicle, entry: _ModeEntry) -> None:
        """Reports that PX4 began or stopped to defer a failsafe."""
        name = entry.mode.name
        if entry.failsafe_deferred:
            text = (
                f"PX4 defers a failsafe for up to {entry.mode.defer_failsafes_s} s, because the vehicle "
                f"flies in the mode {name!r}. The failsafe acts after that time, or as soon as the vehicle "
                "leaves the mode."
            )
            add_event(vehicle, self._clock, name, "failsafe_deferred", text, WARNING)
        else:
            text = f"PX4 no longer defers a failsafe for the mode {name!r}."
            add_event(vehicle, self._clock, name, "failsafe_not_deferred", text, NOTICE)

    async def _begin(self, vehicle: Vehicle, mode: str, entry: _ModeEntry, ticket: Ticket) -> None:
        """Starts or resumes the mission; if this is not possible, the vehicle holds. A command that is
        accepted meanwhile cancels the ticket, and decides the mode."""
        mission_mode = entry.mode
        by = f"The mode {mission_mode.name!r}"
        try:
            with closing(ticket):
                await self._begin_mission(vehicle, mode, entry, ticket)
        except GcsError as error:
            await self._other_command_done(vehicle)
            if vehicle.status.mode != mode and isinstance(error, Interrupted):
                return
            text = f"The mission of the mode {mission_mode.name!r} cannot be flown: {with_remedy(error)}"
            add_event(
                vehicle, self._clock, mission_mode.name, "not_started", f"{text} The vehicle holds.", WARNING
            )
            if vehicle.status.mode == mode:
                self._streams.complete_mode(vehicle.id, mode, False)
                await vehicle.command.hold(by=by)

    async def _begin_mission(self, vehicle: Vehicle, mode: str, entry: _ModeEntry, ticket: Ticket) -> None:
        mission_mode = entry.mode
        by = f"The mode {mission_mode.name!r}"
        on_ground = vehicle.status.landed_state == "on_ground"
        if on_ground and not mission_mode.takes_off:
            raise Refused("The mission begins in the air.", remedy="Take off first, then select the mode.")
        flight = self._missions.flown_in(vehicle.id, mode)
        if flight is not None and flight.runner.in_charge:
            return
        if mission_mode.takes_off:
            await self._wait_until_in_charge(vehicle.id, mission_mode.name)
        start = None
        if flight is None or on_ground:
            start = await self._mission_to_begin(vehicle, entry)
        await self._other_command_done(vehicle)  # such as the one that has selected the mode
        ticket.require()
        if flight is not None and on_ground:
            flight.abort(by, "hold")  # sends no command, because the mission is suspended
        if start is None:
            assert flight is not None
            with flight.commanded(ticket):
                flight.resume(by)
        elif vehicle.status.mode == mode and vehicle.status.armed:
            self._abort_in_lost_mode(vehicle, by)
            self._missions.begin({vehicle.id: replace(start, mode=mode)}, {vehicle.id: ticket})

    def _abort_in_lost_mode(self, vehicle: Vehicle, by: str) -> None:
        """Ends a suspended mission whose mode PX4 has under another number now, or no longer: it cannot be
        resumed there. PX4 keeps the number of a mode that was lost for about a second."""
        registered = {self._registration(vehicle.id, name).mode for name in self._vehicles[vehicle.id].modes}
        flight = self._missions.find_flight(vehicle.id)
        if flight is None or flight.over or flight.runner.in_charge or flight.mode in {OFFBOARD, *registered}:
            return
        flight.abort(by, "hold")  # sends no command, because the mission is suspended

    async def _other_command_done(self, vehicle: Vehicle) -> None:
        """Returns once no client's command to the vehicle is being executed."""
        while vehicle.tickets.commanding() is not None:
            await self._clock.sleep(UPDATE_PERIOD_S / 2)

    async def _mission_to_begin(self, vehicle: Vehicle, entry: _ModeEntry) -> Start:
        """The mission to begin now.

        PX4 learns up to 1 s late that the mission must be compiled again. If the vehicle was armed in that
        second, the mission is compiled here.
        """
        on_ground = vehicle.status.landed_state == "on_ground"
        start = None if entry.preparation is None or not on_ground else entry.preparation.start
        if start is None:
            return await self._preparer.prepare(vehicle.id, entry.mode)
        if start.timeline.avoidance:
            await self._streamer.offboard(vehicle.id).avoidance.wait_for_sensor()
        return start

    async def _wait_until_in_charge(self, vehicle_id: str, name: str) -> None:
        """Returns once PX4 reports that the mode's executor is in charge; raises Refused after the
        timeout."""
        until_s = self._clock.monotonic_s() + IN_CHARGE_TIMEOUT_S
        while (executor := self._registration(vehicle_id, name).executor) is None or not executor.in_charge:
            if self._clock.monotonic_s() >= until_s:
                raise Refused(
                    "PX4 did not put the mode's executor in charge.", remedy="Select the mode again."
                )
            await self._clock.sleep(UPDATE_PERIOD_S / 2)

    # --- inside -----------------------------------------------------------------------------------

    def _vehicle(self, vehicle_id: str) -> Vehicle:
        return self._streamer.offboard(vehicle_id).vehicle

    def _registration(self, vehicle_id: str, name: str) -> Registration:
        registrations = (each for each in self._streams.modes().get(vehicle_id, ()) if each.name == name)
        return next(registrations, Registration(name, "lost", None, REPLIES_ENDED))

    def _drop(self, vehicle_id: str, name: str) -> None:
        self._streams.unregister_mode(vehicle_id, name)
        if (state := self._vehicles.get(vehicle_id)) is not None:
            state.modes.pop(name, None)

    def _require_attached(self, vehicle: Vehicle, name: str) -> None:
        """Raises UnknownVehicle if the vehicle was removed while its mode was registered."""
        try:
            attached = self._vehicle(vehicle.id)
        except UnknownVehicle:
            attached = None
        if attached is not vehicle:
            self._streams.unregister_mode(vehicle.id, name)
            raise UnknownVehicle(vehicle.id, sorted(self._vehicles))

    @staticmethod
    def _status(entry: _ModeEntry, registration: Registration) -> MissionModeStatus:
        mode, preparation = entry.mode, entry.preparation
        registered = registration.state == "registered"
        reason_not_ready = "" if preparation is None or not registered else preparation.reason
        return MissionModeStatus(
            name=mode.name,
            state=registration.state,
            mode=registration.mode,
            ready=registered and not reason_not_ready,
            reason=registration.reason or reason_not_ready,
            mission=mode.mission.name,
            plan_id=mode.mission.plan_id,
            version=mode.mission.version,
            client=mode.client,
            defer_failsafes_s=mode.defer_failsafes_s,
            failsafe_deferred=registration.failsafe_deferred,
            takes_off=mode.takes_off,
        )


def _cannot_register(vehicle_id: str, error: ValueError) -> Refused:
    return Refused(f"Vehicle {vehicle_id}: {error}.", remedy="Remove a mode first, or choose another name.")


def _ros2_address(vehicle: Vehicle) -> DdsAddress:
    """Raises Refused if the vehicle has no ROS 2 connection."""
    address = dds_address(vehicle.endpoints)
    if address is None:
        raise Refused(
            f"No ROS 2 connection to vehicle {vehicle.id}. PX4 registers flight modes only over ROS 2.",
            remedy="Add a ros2:// link to the vehicle (see Links).",
        )
    return address


def _require_topics(vehicle: Vehicle, topics: Iterable[str]) -> None:
    """Raises Refused if the vehicle lacks one of these topics, or has it in a layout that is not known;
    NotYet if the vehicle may still report it."""
    unusable = unusable_topics(vehicle.endpoints)
    require_usable(next((unusable[topic] for topic in sorted(topics) if topic in unusable), None))
