"""Vehicles that fly as one group: they start together, are kept apart, and are stopped in one call.

    starting ── all confirmed ──► waiting ── start time ──► flying ──► holding ──► ended
        └────────── one vehicle fails: all into Hold ────────────────────────────────┘

A group flies setpoints, or a mission in which each vehicle has a role. With setpoints, each member's own
stream (`offboard/control.py`) sends the member's position until the scheduler sets the first setpoints of all
members in one step. A group with a mission (`group_mission.py`) flies from its first moment until the mission
ends. The guard (`streamer/separation.py`) keeps the vehicles apart.
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, replace

from gcs_server.clock import Clock
from gcs_server.errors import GcsError, NoReply, NotTogether, Refused, Rejected, UnknownGroup
from gcs_server.faults import Isolation
from gcs_server.flights.group import (
    MIN_LEAD_S,
    Group,
    GroupChecks,
    GroupFinding,
    GroupRequest,
    GroupStatus,
    listed,
)
from gcs_server.flights.group_mission import GroupMission
from gcs_server.mavlink.dialect import MAV_SEVERITY_INFO, MAV_SEVERITY_WARNING
from gcs_server.streamer.offboard.control import OffboardControl
from gcs_server.streamer.process.streams import Streams
from gcs_server.streamer.separation import EXPIRY_TOLERANCE_S, Finding, GroupGuard, GuardState
from gcs_server.streamer.values.stream_request import OnExpiry, StreamRequest
from gcs_server.supervise import Supervisor
from gcs_server.vehicle.events import EventFeed
from gcs_server.vehicle.tickets import Ticket
from missions.setpoints import Position, Setpoint

log = logging.getLogger(__name__)

START_DELAY_S = 0.5
"""Time from the last confirmation to the common start, if the request gives no start time."""
MAX_WAIT_S = 600.0
"""Maximum time for which a member keeps its position before the start, until all members are ready [s]."""
UPDATE_PERIOD_S = 0.1
FINDINGS_KEPT, GROUPS_KEPT = 50, 20
HOLD_TIMEOUT_S = 10.0


class Groups:
    """All groups of the server.

    Args:
        clock: the server's clock.
        streams: sends the setpoints.
        events: receives an event for each change of a group.
        find: returns a vehicle's stream by its id; raises UnknownVehicle.
    """

    def __init__(
        self,
        clock: Clock,
        streams: Streams,
        events: EventFeed,
        find: Callable[[str], OffboardControl],
    ) -> None:
        self._clock = clock
        self._streams, self._events = streams, events
        self._isolation = Isolation(clock, log, "The groups")
        self._find = find
        self._checks = GroupChecks(clock, streams)
        self._groups: dict[str, Group] = {}
        self._count = 0

    def start_updates(self, supervisor: Supervisor) -> None:
        """Starts the periodic update."""
        supervisor.repeat("groups", self.update, UPDATE_PERIOD_S)

    def faults(self) -> list[str]:
        """Messages about current faults of this server's code."""
        return self._isolation.faults

    # --- commands ---------------------------------------------------------------------------------

    async def start(self, request: GroupRequest, tickets: Mapping[str, Ticket] | None = None) -> GroupStatus:
        """Brings all members into Offboard at their positions and starts them at the same time. Returns
        once all have confirmed Offboard and the start time is set, possibly before the start.

        Args:
            request: the members and their first setpoints.
            tickets: the ticket of the command, by vehicle id; None: each member's start opens its own.

        Raises:
            Interrupted: a ticket was cancelled.
            NotTogether: a vehicle cannot join, or two vehicles would come too close. No vehicle has moved,
                and all are in Hold.
            InvalidRequest: a setpoint or the start time is not valid.
        """
        self._checks.check_start_time(request, MIN_LEAD_S)
        members = self._joinable(request)
        tickets = tickets or {}
        for ticket in tickets.values():
            ticket.claim()
        requests = self._checks.stream_requests(request, request.setpoints)
        await self._checks.check_separation(request.minimum_separation_m, members, requests)
        members = self._joinable(request)  # another request may have been accepted meanwhile
        self._checks.check_separation_now(request.minimum_separation_m, members, requests)
        group = self._add(request, members)
        self._announce(group, f"Group {group.id} ({listed(members)}) of {request.client} is being started.")
        waiting_requests: dict[str, StreamRequest] = {}
        try:
            waiting_requests = await self._start_streams(group, tickets)
            await self._checks.check_separation(request.minimum_separation_m, members, requests)
            group.require_following({v: self._streams.state(v) for v in members})
            for index, member in enumerate(members.values()):  # some seconds have passed
                self._checks.check_setpoint(member, index, requests[member.vehicle.id])
            self._checks.check_separation_now(request.minimum_separation_m, members, requests)
            self._checks.check_start_time(request, 0.1)
            for ticket in tickets.values():
                ticket.require()
        except GcsError as error:
            await self._abort_start(group, str(error), tickets)
            raise
        except BaseException:
            for vehicle_id in members:
                self._streams.force_hold(vehicle_id, f"The start of group {group.id} was cancelled")
            self._end(group, "The start was cancelled.")
            raise
        self._start_together(group, waiting_requests, requests)
        return self._status(group)

    def begin_mission(self, mission: GroupMission, minimum_m: float) -> None:
        """Begins a mission with all its vehicles, or with none, as a group that ends with the mission.

        Raises:
            Refused: one vehicle cannot start.
        """
        requests = mission.begin()
        members = {each.vehicle_id: self._find(each.vehicle_id) for each in mission.flights.values()}
        # the mission renews its own setpoints, so those of the request are not used
        request = GroupRequest({}, minimum_m, math.inf, OnExpiry("hold"), mission.client)
        group = self._add(request, members)
        group.mission, group.state, group.start_unix_s = mission, "flying", group.created_unix_s
        self._watch_mission(group)
        mission.execute(requests)
        text = f"Group {group.id} ({listed(members)}) flies the mission {mission.name!r} of {mission.client}."
        self._announce(group, text)

    async def setpoints(
        self,
        group_id: str,
        changed: Mapping[str, Setpoint],
        valid_for_s: float,
        on_expiry: OnExpiry,
        client: str,
        client_key: str = "",
    ) -> GroupStatus:
        """Sends new setpoints to some or all members at the same time, and renews all others.

        Raises:
            Refused: the group is no longer flying, or a member is held.
            NotTogether: two vehicles would come too close; all continue with their previous setpoints.
        """
        group = self._find_group(group_id)
        async with group.change_lock:  # each change is checked against the result of the previous change
            renewal = replace(
                group.request,
                valid_for_s=valid_for_s,
                on_expiry=on_expiry,
                client=client,
                client_key=client_key,
            )
            return await self._change(group, changed, renewal)

    async def _change(
        self, group: Group, changed: Mapping[str, Setpoint], renewal: GroupRequest
    ) -> GroupStatus:
        group_id, minimum_m, valid_for_s = group.id, renewal.minimum_separation_m, renewal.valid_for_s
        held = group.require_changeable(changed, self._guard(group)).held
        setpoints = group.setpoints | dict(changed)
        request = replace(renewal, setpoints=setpoints)
        requests = self._checks.stream_requests(request, changed)
        self._checks.check_setpoints(group.members, requests)
        paths_s = self._checks.remaining_path_s(group.setpoints, changed)
        await self._checks.check_separation(minimum_m, group.members, requests, held, paths_s + valid_for_s)
        # the vehicles have moved during the prediction
        held = group.require_changeable(changed, self._guard(group)).held
        self._checks.check_setpoints(group.members, requests)
        self._checks.check_separation_now(minimum_m, group.members, requests, held)
        paths_s = self._checks.remaining_path_s(group.setpoints, changed)
        until_s = self._clock.monotonic_s() + paths_s + valid_for_s
        snapshots = {v: group.members[v].snapshot(requests[v]) for v in changed}
        if not await self._streams.change_together(group_id, requests, snapshots, until_s):
            raise Refused(
                f"Group {group_id} is ending, or its setpoints have expired.",
                remedy="While the members hold their positions, send setpoints for all members; otherwise "
                "start a new group.",
            )
        group.request, group.setpoints = request, setpoints
        return self._status(group)

    async def hold(
        self, group_id: str, client: str, tickets: Mapping[str, Ticket] | None = None
    ) -> GroupStatus:
        """Puts all members that still follow the group into Hold; members that have left are not affected.

        Args:
            group_id: the group.
            client: name of the client.
            tickets: the ticket of the command, by vehicle id.

        Raises:
            NoReply: a member did not confirm; the error names it, and its stream keeps requesting Hold.
        """
        group = self._find_group(group_id)
        if group.state == "ended":
            return self._status(group)
        group.requested_end = f"{client} commanded Hold."
        if group.guard is not None:
            self._streams.disable_guard(group.id)
        failed = await self._hold(group, group.members, tickets, client)
        if failed:
            raise NoReply(
                " ".join(f"Vehicle {v} did not confirm Hold: {error}" for v, error in failed.items()),
                deadline_s=HOLD_TIMEOUT_S,
                remedy="Watch the vehicle; any client may command Hold, Land now and Stop motors.",
            )
        if group.mission is not None:
            group.mission.stop(group.requested_end.rstrip("."))
        if group.guard is not None:
            self._end(group, None)
        return self._status(group)

    def get(self, group_id: str) -> GroupStatus:
        """Status of one group. Raises UnknownGroup."""
        return self._status(self._find_group(group_id))

    def members(self, group_id: str) -> tuple[str, ...]:
        """Vehicle ids of one group. Raises UnknownGroup."""
        return tuple(self._find_group(group_id).members)

    def all(self) -> list[GroupStatus]:
        """All groups, including those that ended recently; oldest first."""
        return [self._status(group) for group in self._groups.values()]

    def update(self) -> None:
        """Publishes the guards' findings, updates missions, and ends groups that no vehicle follows; called
        periodically. A fault in one group affects only that group."""
        # before the missions, so that a stop by the guard is not handled as a failure of the mission
        self._collect_findings()
        for group in list(self._groups.values()):
            self._isolation.run(f"the update of group {group.id}", self._update, group)

    def _update(self, group: Group) -> None:
        guard = self._guard(group)
        if guard is None or group.state == "ended":
            return
        if group.mission is not None:
            self._update_mission(group, group.mission)
            return
        phases = {self._phase(group, v) for v in group.members}
        if guard.phase == "over" or phases == {"idle"}:
            self._end(group, None)
        elif group.state == "waiting" and guard.phase == "flying" and not guard.held:
            group.state = "flying"
            self._announce(group, f"Group {group.id} has started: {listed(group.members)} fly together.")
        elif group.state in ("waiting", "flying") and "streaming" not in phases:
            group.state = "holding"
            self._announce(group, f"Group {group.id} is being stopped.")
        elif group.state == "holding" and "streaming" in phases:
            group.state = "flying"

    def _update_mission(self, group: Group, mission: GroupMission) -> None:
        if self._streams.guard(group.id) is None:  # the stream process was restarted
            self._watch_mission(group)
        mission.update()
        if mission.over:
            self._end(group, None)

    def disable_guards(self) -> None:
        """Called at shutdown before all streams stop, so that the guards do not report the stops."""
        for group in self._groups.values():
            if group.guard is not None and group.state != "ended":
                group.requested_end = "The server was shut down."
                self._streams.disable_guard(group.id)

    # --- starting ---------------------------------------------------------------------------------

    def _add(self, request: GroupRequest, members: dict[str, OffboardControl]) -> Group:
        self._count += 1
        group = Group(str(self._count), request, dict(request.setpoints), members, self._clock.unix_s())
        self._groups[group.id] = group
        ended = [each.id for each in self._groups.values() if each.state == "ended"]
        for group_id in ended[: max(0, len(self._groups) - GROUPS_KEPT)]:
            del self._groups[group_id]
        return group

    def _joinable(self, request: GroupRequest) -> dict[str, OffboardControl]:
        """All members; raises an error if a member cannot join now."""
        members = {vehicle_id: self._find(vehicle_id) for vehicle_id in request.setpoints}
        for index, (vehicle_id, member) in enumerate(members.items()):
            other = self._group_of(vehicle_id)
            if other is not None:
                raise NotTogether(
                    f"Vehicle {vehicle_id} is already in group {other.id}.",
                    vehicles=(vehicle_id,),
                    remedy=f"Hold group {other.id} first.",
                )
            self._checks.check_member(member, index, request)
        return members

    async def _start_streams(self, group: Group, tickets: Mapping[str, Ticket]) -> dict[str, StreamRequest]:
        """Streams the positions of all members and switches them to Offboard; if one fails, all hold. Returns
        the streamed requests."""
        request = group.request
        waiting_requests: dict[str, StreamRequest] = {}
        failed: dict[str, GcsError] = {}
        for vehicle_id, member in group.members.items():
            position_now = member.snapshot().position_at(self._clock.monotonic_s())
            if position_now is None:
                raise NotTogether(
                    f"Vehicle {vehicle_id} has no valid position estimate.", vehicles=(vehicle_id,)
                )
            waiting_requests[vehicle_id] = StreamRequest(
                Position(position_now),
                MAX_WAIT_S,
                OnExpiry("hold", 1.0),
                request.client,
                request.client_key,
                "group",
            )
            group.stream_numbers[vehicle_id] = self._streams.state(vehicle_id).number + 1

        async def join(vehicle_id: str, member: OffboardControl) -> None:
            try:
                ticket = tickets.get(vehicle_id)
                await member.start(waiting_requests[vehicle_id], group.request.rate_hz, ticket=ticket)
            except GcsError as error:
                group.stream_numbers.pop(vehicle_id)  # the stream has ended, or is in the phase `undoing`
                first = not failed
                if first or not isinstance(error, Refused):  # Refused: cancelled after the first failure
                    failed[vehicle_id] = error
                if first:
                    await self._hold(group, list(group.stream_numbers), tickets)

        async with asyncio.TaskGroup() as tasks:
            for vehicle_id, member in group.members.items():
                tasks.create_task(join(vehicle_id, member))
        if failed:
            reasons = tuple(
                reason for e in failed.values() if isinstance(e, Rejected) for reason in e.reasons
            )
            vehicle_errors = " ".join(f"Vehicle {v}: {error}" for v, error in failed.items())
            raise NotTogether(
                f"Not all vehicles could be brought into Offboard, so none moves. {vehicle_errors}",
                vehicles=tuple(failed),
                reasons=reasons,
            )
        return waiting_requests

    def _start_together(
        self, group: Group, waiting: Mapping[str, StreamRequest], requests: Mapping[str, StreamRequest]
    ) -> None:
        request = group.request
        lead_s = START_DELAY_S
        if request.start_at_unix_s is not None:
            lead_s = request.start_at_unix_s - self._clock.unix_s()
        start_s = self._clock.monotonic_s() + lead_s
        group.start_unix_s = self._clock.unix_s() + lead_s
        guard = GroupGuard(
            group.id,
            waiting,
            requests,
            minimum_m=request.minimum_separation_m,
            start_s=start_s,
            duration_s=max(r.duration_s for r in requests.values()),
            others_go_on=request.others_go_on,
        )
        group.state, group.guard = "waiting", guard.state()
        self._streams.watch(guard)
        self._announce(
            group, f"Group {group.id}: all members are in Offboard and start together in {lead_s:.1f} s."
        )

    def _watch_mission(self, group: Group) -> None:
        guard = GroupGuard(
            group.id,
            {},
            dict.fromkeys(group.members),
            minimum_m=group.request.minimum_separation_m,
            start_s=self._clock.monotonic_s(),
            duration_s=math.inf,
        )
        group.guard = guard.state()
        self._streams.watch(guard)

    async def _abort_start(self, group: Group, reason: str, tickets: Mapping[str, Ticket]) -> None:
        failed = await self._hold(group, list(group.stream_numbers), tickets)
        for vehicle_id, error in failed.items():
            reason += f" Vehicle {vehicle_id} did not confirm Hold: {error}"
        self._end(group, reason)

    async def _hold(
        self, group: Group, members: Iterable[str], tickets: Mapping[str, Ticket] | None, by: str = ""
    ) -> dict[str, GcsError]:
        """Stops all members whose stream belongs to the group; returns the errors by vehicle. A member whose
        ticket was cancelled follows the command that cancelled it."""
        failed: dict[str, GcsError] = {}

        async def stop(vehicle_id: str) -> None:
            ticket = None if tickets is None else tickets.get(vehicle_id)
            valid_ticket = ticket if ticket is not None and ticket.reason is None else None
            member = group.members[vehicle_id]
            try:
                if self._phase(group, vehicle_id) != "idle":
                    await member.stop(valid_ticket)
                elif group.mission is not None and member.vehicle.status.armed:  # PX4 flies a part by itself
                    await member.vehicle.command.hold(by=by, ticket=valid_ticket)
            except GcsError as error:
                failed[vehicle_id] = error

        async with asyncio.TaskGroup() as tasks:
            for vehicle_id in members:
                tasks.create_task(stop(vehicle_id))
        return failed

    # --- events -----------------------------------------------------------------------------------

    def _collect_findings(self) -> None:
        for group_id, finding in self._streams.take_findings():
            if (group := self._groups.get(group_id)) is not None:
                self._isolation.run(f"a finding of group {group_id}", self._add_finding, group, finding)

    def _add_finding(self, group: Group, finding: Finding) -> None:
        ago_s = self._clock.monotonic_s() - finding.at_s
        departed = finding.vehicles if finding.code == "left" else ()  # the group does not hold these
        held = [vehicle_id for vehicle_id in finding.held if vehicle_id not in departed]
        hold = f" {listed(held)} {'holds' if len(held) == 1 else 'hold'}." if held else ""
        group_finding = GroupFinding(
            unix_s=self._clock.unix_s() - ago_s,
            code=finding.code,
            vehicles=finding.vehicles,
            held=tuple(held),
            text=finding.text + hold,
            distance_m=finding.distance_m,
        )
        group.findings = [*group.findings, group_finding][-FINDINGS_KEPT:]
        if group.mission is not None:
            group.mission.stop(f"{finding.text.rstrip('.')}: all hold")
        self._announce(group, f"Group {group.id}: {group_finding.text}", warning=True)

    def _end(self, group: Group, reason: str | None) -> None:
        if group.state == "ended":
            return
        self._collect_findings()
        guard = self._guard(group)
        if reason is None and guard is not None:
            now_s = self._clock.monotonic_s()
            expired = not guard.held and now_s >= guard.until_s - EXPIRY_TOLERANCE_S
            reason = "The setpoints expired." if expired else "All vehicles have left the group."
            if group.mission is not None:
                reason = group.mission.end_reason
            elif group.findings:
                reason = group.findings[-1].text
            reason = group.requested_end or reason
        group.state, group.end_reason = "ended", reason
        self._streams.unwatch(group.id)
        self._announce(group, f"Group {group.id} has ended: {reason}")

    def _announce(self, group: Group, text: str, *, warning: bool = False) -> None:
        severity = MAV_SEVERITY_WARNING if warning else MAV_SEVERITY_INFO
        data = {"group": asdict(self._status(group))}
        self._events.add("group", self._clock.unix_s(), text, severity=severity, data=data)

    def _status(self, group: Group) -> GroupStatus:
        self._guard(group)
        return group.status({v: self._streams.state(v) for v in group.members})

    # --- inside -----------------------------------------------------------------------------------

    def _guard(self, group: Group) -> GuardState | None:
        """Newest state of the guard, also after the group's end; None before all members have confirmed."""
        if group.guard is not None and group.state != "ended":
            group.guard = self._streams.guard(group.id) or group.guard
        return group.guard

    def _phase(self, group: Group, vehicle_id: str) -> str:
        """Phase of the group's own stream to a member."""
        return group.phase(vehicle_id, self._streams.state(vehicle_id))

    def _find_group(self, group_id: str) -> Group:
        group = self._groups.get(group_id)
        if group is None:
            known = ", ".join(self._groups)
            raise UnknownGroup(
                f"There is no group {group_id!r}.",
                remedy=f"Known groups: {known}." if known else "No group has been started yet.",
            )
        return group

    def _group_of(self, vehicle_id: str) -> Group | None:
        groups = self._groups.values()
        return next((g for g in groups if vehicle_id in g.members and g.state != "ended"), None)
