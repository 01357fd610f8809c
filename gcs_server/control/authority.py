"""Decides which client may command a vehicle; every command is checked here. The module has a lease for each
vehicle and the list of connected clients (open telemetry sockets). It publishes each change, writes it to the
journal, and executes `on_expiry` when the client in control (the holder) is no longer connected.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Generator, Iterable
from contextlib import contextmanager
from dataclasses import asdict, dataclass

from gcs_server.clock import Clock
from gcs_server.control.commands import BY_NAME, Command
from gcs_server.control.journal import Journal
from gcs_server.control.lease import (
    MAX_REQUESTS,
    ControlChange,
    ControlRequest,
    Lease,
    LeaseTimes,
    OnControlLost,
)
from gcs_server.control.principal import Principal
from gcs_server.errors import GcsError, NotInControl, Refused, UnknownVehicle
from gcs_server.mavlink import dialect as d
from gcs_server.supervise import Supervisor
from gcs_server.vehicle.fleet import Fleet, Notice
from gcs_server.vehicle.mode_cause import ModeCause
from gcs_server.vehicle.vehicle import Vehicle

log = logging.getLogger(__name__)

EXPIRY_PERIOD_S = 0.5
FLYING_LANDED_STATES = ("in_air", "taking_off", "landing")
MOVING_MODES = frozenset({"takeoff", "mission", "orbit", "follow", "offboard"})
"""Modes in which the vehicle moves without a pilot, so that Hold stops it. In other modes a pilot flies, or
the vehicle hovers or lands."""


@dataclass(frozen=True, slots=True)
class ControlStatus:
    """State of control: the topic `control`, and the response of the control routes."""

    holder: str | None
    """The client in control; null: no client (the next client that sends a command takes control)."""
    holder_key: str | None
    """Distinguishes clients with the same name; `GET /me` returns the caller's own key."""
    since_unix_s: float | None
    expires_in_s: float | None
    """Time until control ends if the client in control sends no request [s]. Each request renews it; it does
    not expire while the client's telemetry socket is open.
    """
    can_be_asked: bool
    """Whether the client in control can be asked, because its telemetry socket is open."""
    on_expiry: OnControlLost | None
    """Command sent to the flying vehicle when control expires."""
    requests: tuple[ControlRequest, ...]
    """Clients that request control."""
    lease_s: float
    """Duration of control without a request [s]."""
    answer_s: float
    """Time to answer a request before control may be taken by force [s]."""
    mode_cause: ModeCause | None
    """Cause of the vehicle's current mode; null: the mode has not changed since the vehicle connected."""


class VehicleControl:
    """The attribute `control` of a vehicle."""

    def __init__(self, vehicle: Vehicle, lease: Lease) -> None:
        self.vehicle = vehicle
        self.lease = lease

    def status(self) -> ControlStatus:
        """Current state of control."""
        lease = self.lease
        holder = lease.holder
        return ControlStatus(
            holder=None if holder is None else str(holder),
            holder_key=None if holder is None else holder.key,
            since_unix_s=lease.since_unix_s,
            expires_in_s=lease.expires_in_s,
            can_be_asked=lease.can_be_asked,
            on_expiry=lease.on_expiry,
            requests=lease.requests(),
            lease_s=lease.times.lease_s,
            answer_s=lease.times.answer_s,
            mode_cause=self.vehicle.mode_cause,
        )


class Authority:
    """Control of all vehicles.

    Args:
        clock: the clock of the leases.
        fleet: the vehicles; the attribute `control` of each vehicle is set.
        journal: records each change of control.
        supervisor: owns the task of each expiry action.
        lease_times: durations of leases and answers.
    """

    def __init__(
        self,
        clock: Clock,
        fleet: Fleet,
        journal: Journal,
        supervisor: Supervisor,
        lease_times: LeaseTimes | None = None,
    ) -> None:
        self._clock = clock
        self._fleet = fleet
        self._journal = journal
        self._supervisor = supervisor
        self._lease_times = lease_times or LeaseTimes()
        self._connected: Counter[str] = Counter()
        self._answered: Counter[str] = Counter()
        """Number of requests that are being answered, by key of the client."""
        self._controls: dict[str, VehicleControl] = {}
        fleet.on_vehicle_added(self._attach)
        fleet.on_vehicle_removed(self._detach)

    def start(self) -> None:
        """Starts the periodic expiry of leases."""
        self._supervisor.repeat("control", self._expire_due, EXPIRY_PERIOD_S)

    # --- clients --------------------------------------------------------------------------------

    @contextmanager
    def connected(self, client: Principal) -> Generator[None]:
        """Marks a client as connected while its telemetry socket is open."""
        self._connected[client.key] += 1
        try:
            yield
        finally:
            self.renew(client)
            _decrease(self._connected, client.key)

    @contextmanager
    def answering(self, client: Principal) -> Generator[None]:
        """Keeps a client's control while one of its requests is being answered, and renews it before and
        after."""
        self.renew(client)
        self._answered[client.key] += 1
        try:
            yield
        finally:
            self.renew(client)
            _decrease(self._answered, client.key)

    def renew(self, client: Principal) -> None:
        """Called with each request of a client: renews its leases."""
        for lease in self._leases():
            lease.expire_due()
            lease.renew(client)

    def controlled_by(self, client: Principal) -> list[str]:
        """Ids of the vehicles that the client controls."""
        return [vehicle_id for vehicle_id, key in self._holders() if key == client.key]

    def controls_any(self, client_key: str) -> bool:
        """Whether the client of this key controls a vehicle."""
        return any(key == client_key for _, key in self._holders())

    def warnings(self) -> list[Notice]:
        """Warnings for vehicles with the maximum number of control requests."""
        return [
            Notice(
                "control",
                f"{MAX_REQUESTS} clients request control of vehicle {vehicle_id}; further requests are "
                "refused until the client in control answers some.",
                vehicle=vehicle_id,
            )
            for vehicle_id, control in self._controls.items()
            if control.lease.has_max_requests
        ]

    # --- commands -------------------------------------------------------------------------------

    def admit(self, principal: Principal, command: Command, vehicle_id: str) -> None:
        """Called before each command: accepts it (and takes control if no client has it) or refuses it.

        Raises:
            NotInControl: another client has control, and the command requires it.
        """
        if command.control != "lease":
            return
        lease = self._lease(vehicle_id)
        if lease is not None:
            lease.admit(principal)

    def refusal(self, principal: Principal, name: str, vehicle_ids: Iterable[str]) -> NotInControl | None:
        """The first refusal of a command to several vehicles; None: allowed. Does not take control."""
        if BY_NAME[name].control not in ("lease", "not_anothers"):
            return None
        for vehicle_id in vehicle_ids:
            lease = self._lease(vehicle_id)
            refusal = None if lease is None else lease.refusal(principal)
            if refusal is not None:
                return refusal
        return None

    def report_command(self, principal: Principal, command: Command, vehicle_id: str) -> None:
        """Called after each successful command: informs the client in control about commands of other
        clients."""
        if command.control != "open":
            return
        lease = self._lease(vehicle_id)
        if lease is not None:
            lease.report_intervention(principal, command.label)

    def control(self, vehicle_id: str) -> VehicleControl:
        """The control of a vehicle.

        Raises:
            UnknownVehicle: no vehicle has this id.
            Refused: the vehicle belongs to a recording.
        """
        vehicle = self._fleet.get(vehicle_id)
        if vehicle.identity.replayed:
            raise Refused(f"Vehicle {vehicle_id} is a recording; nobody controls it.")
        return self._controls[vehicle_id]

    # --- internal -------------------------------------------------------------------------------

    def _attach(self, vehicle: Vehicle) -> None:
        lease = Lease(
            self._clock,
            vehicle.id,
            self._lease_times,
            lambda client: client.key in self._connected,
            lambda client: client.key in self._answered,
            lambda change: self._publish_change(vehicle, control, change),
        )
        vehicle.control = self._controls[vehicle.id] = control = VehicleControl(vehicle, lease)

    def _detach(self, vehicle: Vehicle) -> None:
        self._controls.pop(vehicle.id, None)

    def _holders(self) -> Generator[tuple[str, str]]:
        """(vehicle id, key of the client in control) of all controlled vehicles."""
        for vehicle in self._fleet.all():
            holder = self._controls[vehicle.id].lease.holder
            if holder is not None:
                yield vehicle.id, holder.key

    def _lease(self, vehicle_id: str) -> Lease | None:
        """The lease of a vehicle; None for an unknown or a recorded vehicle, whose commands are refused
        elsewhere."""
        try:
            vehicle = self._fleet.get(vehicle_id)
        except UnknownVehicle:
            return None
        return None if vehicle.identity.replayed else self._controls[vehicle_id].lease

    def _leases(self) -> list[Lease]:
        return [control.lease for control in self._controls.values()]

    def _publish_change(self, vehicle: Vehicle, control: VehicleControl, change: ControlChange) -> None:
        previous = change.previous
        if previous is not None and (change.holder is None or change.holder.key != previous.key):
            vehicle.tickets.end_of_control(previous.key, f"The client lost control: {change.text}")
        is_warning = change.action in ("forced", "expired", "intervened")
        vehicle.events.add(
            "control",
            self._clock.unix_s(),
            change.text,
            severity=d.MAV_SEVERITY_WARNING if is_warning else d.MAV_SEVERITY_NOTICE,
            data={
                "action": change.action,
                "client": str(change.client),
                "client_key": change.client.key,
                "previous": None if change.previous is None else str(change.previous),
                "previous_key": None if change.previous is None else change.previous.key,
                "to_key": None if change.requester is None else change.requester.key,
                "reason": change.reason,
                "control": asdict(control.status()),
            },
        )
        if change.action == "expired":
            self._journal.add("server", "control/expired", vehicle.id, {}, "ok", change.text, 0.0)
            if change.on_expiry != "nothing":
                self._supervisor.spawn("control-lost", self._execute_on_expiry(vehicle, change))

    async def _execute_on_expiry(self, vehicle: Vehicle, change: ControlChange) -> None:
        """Executes `on_expiry` of a client that is no longer connected, but never while a pilot flies the
        vehicle."""
        action, started_s = change.on_expiry, self._clock.monotonic_s()
        await vehicle.command.wait_for_kill()  # afterwards the action may be unnecessary
        status = vehicle.status
        commanded_by_server = status.mode != "offboard" or vehicle.streaming
        in_registered_mode = status.mode in vehicle.mode_names.external and vehicle.streaming
        moves_by_itself = (status.mode in MOVING_MODES and commanded_by_server) or in_registered_mode
        mission = vehicle.offboard_mission
        moves_by_itself = moves_by_itself and not (mission is not None and mission.flown_by_pilot)
        action_leaves_hold = status.mode == "hold" and action != "hold"
        is_flying = status.armed and status.landed_state in FLYING_LANDED_STATES
        if not is_flying or not (moves_by_itself or action_leaves_hold):
            return
        command = {"hold": vehicle.command.hold, "land": vehicle.command.land, "rtl": vehicle.command.rtl}
        result, detail = "ok", change.text
        try:
            await command[action](by=f"The server ({change.client} is no longer connected)")
        except GcsError as error:
            result, detail = error.code, str(error)
            log.warning("vehicle %s: control ended, and %s failed: %s", vehicle.id, action, error)
        self._journal.add(
            "server", action, vehicle.id, {}, result, detail, self._clock.monotonic_s() - started_s
        )

    def _expire_due(self) -> None:
        for control in list(self._controls.values()):
            control.vehicle.isolation.run("the expiry of its control", control.lease.expire_due)


def _decrease(counter: Counter[str], key: str) -> None:
    counter[key] -= 1
    if counter[key] <= 0:
        del counter[key]
