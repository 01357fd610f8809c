"""Uploads, verifies, downloads and clears a vehicle's mission, geofence and rally points.

An upload is complete when a download returns what was sent, and PX4 has not rejected the mission. PX4's
ids (MISSION_CURRENT) are not enough: they are checksums of the items that the vehicle received, and show
only that the items have not changed since then. The server stores the ids after a verified transfer. While
the vehicle reports these ids, it has that plan, also after a restart of the server.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import Literal

from gcs_server.errors import Disconnected, GcsError, NoReply, Refused, Rejected
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.dialect import MAVLink_message
from gcs_server.mavlink.mailbox import Reply, Waiter
from gcs_server.vehicle.px4.events import VehicleEvent, rejection_reason
from gcs_server.vehicle.samples import Mission
from gcs_server.vehicle.services.items_cache import ItemsCache
from gcs_server.vehicle.services.mission_compare import differences
from gcs_server.vehicle.services.mission_dialogue import (
    NAME_OF,
    PARTS,
    Clear,
    Dialogue,
    Download,
    Part,
    Target,
    Upload,
)
from gcs_server.vehicle.services.mission_on_vehicle import (
    Ids,
    Items,
    ItemsOnVehicle,
    PlanReference,
    Uploaded,
    failed_upload_text,
    ids_of,
    mission_of,
)
from gcs_server.vehicle.services.port import VehiclePort
from gcs_server.vehicle.services.transaction import Request
from missions.formats.mavlink_items import WireItem

ReportProgress = Callable[[str, float | None], None]
CANCEL_LISTEN_S = 1.0
"""After a cancel: if the vehicle still requests items, the cancel was lost and is sent again."""
IDS_DEADLINE_S = 4.0
IDS_REQUEST_PERIOD_S = 0.5
SET_CURRENT_DEADLINE_S = 6.0
REJECTED_WITHIN_S = 0.5
"""PX4 has checked a mission this long after the acknowledgement [s]; recorded: at most 0.04 s."""
STARTABLE_AFTER_S = 1.0
"""PX4 may refuse to start a mission within this time after the acknowledgement [s]; recorded at 0.05 s."""
_MESSAGES = (
    d.MAVLINK_MSG_ID_MISSION_COUNT,
    d.MAVLINK_MSG_ID_MISSION_REQUEST,
    d.MAVLINK_MSG_ID_MISSION_REQUEST_INT,
    d.MAVLINK_MSG_ID_MISSION_ITEM_INT,
    d.MAVLINK_MSG_ID_MISSION_ACK,
)


class MissionService:
    """Transfers to and from one vehicle, one at a time.

    Every method may raise Refused (nothing was sent), Rejected (with the vehicle's reasons), NoReply and
    Disconnected.
    """

    def __init__(self, vehicle: VehiclePort) -> None:
        self._vehicle = vehicle
        self._running_transfer: str | None = None
        self.items_on_vehicle: ItemsOnVehicle | None = None
        """The vehicle's items after the last completed transfer; None: not known."""
        self._cache: ItemsCache | None = None
        self._searched_ids: Ids | None = None
        """The ids that were last searched in the cache."""
        self.startable_s = float("-inf")
        """Monotonic time from which PX4 starts the mission of this server's last upload [s]."""
        self._rejections: dict[int, str] = {}
        """Why the vehicle will not fly its mission: reasons since the last upload began, by event number."""

    def set_cache(self, cache: ItemsCache) -> None:
        """Sets the cache, which stores known plans for the next start of the server."""
        self._cache = cache

    async def set_items_on_vehicle(self, on_vehicle: ItemsOnVehicle) -> None:
        """Sets the items that the vehicle has, and stores them for the next start of the server."""
        self.items_on_vehicle = on_vehicle
        if self._cache is not None:
            await self._cache.store(self._vehicle.identity.system_id, on_vehicle)

    def take_event(self, event: VehicleEvent) -> None:
        """Remembers an event that states why the vehicle will not fly its mission."""
        reason = rejection_reason(event.id, event.arguments)
        if reason is not None:
            self._rejections[event.sequence] = reason

    def on_ids_reported(self) -> None:
        """After a restart of the server, finds the vehicle's plan by the ids that the vehicle reports."""
        ids = self.ids()
        if (
            self.items_on_vehicle is None
            and ids != self._searched_ids
            and not self._vehicle.identity.replayed
        ):
            self._searched_ids = ids
            self._vehicle.in_background("its known plan", self._restore())

    @property
    def running_transfer(self) -> str | None:
        """Name of the running transfer, as text; None: no transfer."""
        return self._running_transfer

    def ids(self) -> Ids | None:
        """The ids that the vehicle reports for its items; None if it reports no ids."""
        sample = self._vehicle.topic("mission")
        if sample is None or not isinstance(sample.value, Mission):
            return None
        return ids_of(sample.value)

    def is_at_return(self) -> bool:
        """Whether the current item of the mission, or the next one, is the plan's own Return."""
        sample, on_vehicle = self._vehicle.topic("mission"), self.items_on_vehicle
        if on_vehicle is None or on_vehicle.ids != self.ids():
            return False
        assert sample is not None
        assert isinstance(sample.value, Mission)
        current = sample.value.current
        return any(
            item.command == d.MAV_CMD_NAV_RETURN_TO_LAUNCH and item.seq in (current, current + 1)
            for item in on_vehicle.items.get("mission", ())
        )

    def plan_on_vehicle(self) -> Literal["plan", "another", "not_known"]:
        """Whether the vehicle has the plan of the last transfer (`items_on_vehicle`)."""
        on_vehicle, ids = self.items_on_vehicle, self.ids()
        if (
            on_vehicle is None
            or on_vehicle.plan is None
            or ids is None
            or not (any(ids.values()) or any(on_vehicle.ids.values()))
        ):
            return "not_known"
        return "plan" if ids == on_vehicle.ids else "another"

    async def upload(
        self,
        items: Items,
        plan: PlanReference,
        *,
        progress: ReportProgress | None = None,
        before_mission: Callable[[], None] = lambda: None,
    ) -> Uploaded:
        """Replaces mission, geofence and rally points, and reads them back.

        A part without items is cleared. If the upload is cancelled, the vehicle keeps its previous items of
        the current part.

        Args:
            items: the new items.
            plan: identifies their plan.
            progress: called with each step.
            before_mission: called directly before the mission is sent; may raise Refused.

        Raises:
            Rejected: the vehicle refuses an item, or has other items afterwards; the text says which.
        """
        with self._transfer("an upload"):
            report = _CombinedProgress(progress, 2 * sum(len(items[part]) for part in PARTS))
            sent_parts: list[Part] = []
            before = await self._request_ids()
            known = self.items_on_vehicle
            self._rejections = {}
            try:
                for part in PARTS:
                    if part == "mission":
                        before_mission()
                    await self._send_part(part, items[part], report)
                    sent_parts.append(part)
                sent_s = self._vehicle.clock.monotonic_s()
                on_vehicle = await self._read(report, "Verifying")
            except GcsError as error:
                after = None if isinstance(error, Disconnected) else await self._request_ids()
                error.message += " " + failed_upload_text(sent_parts, before, after)
                error.args = (error.message,)
                raise
            self.items_on_vehicle = on_vehicle
            all_differences = [
                each for part in PARTS for each in differences(part, items[part], on_vehicle.items[part])
            ]
            if essential := [each for each in all_differences if each.essential]:
                raise Rejected(
                    f"Vehicle {self._vehicle.id} has a different plan from the one sent: "
                    f"{essential[0].text()}.",
                    reasons=tuple(each.text() for each in essential),
                    remedy="Another station may have uploaded meanwhile. Upload again before you fly.",
                )
            rejections = await self._read_rejections(sent_s) if items["mission"] else ()
            if known is not None and known.ids["mission"] == on_vehicle.ids["mission"]:
                # PX4 ignores a mission that it already has, and does not check it again.
                rejections = rejections or known.rejections
            uploaded = ItemsOnVehicle(
                on_vehicle.items, on_vehicle.ids, plan, on_vehicle.at_unix_s, rejections
            )
            await self.set_items_on_vehicle(uploaded)
            if rejections:
                raise Rejected(
                    f"Vehicle {self._vehicle.id} has stored the plan but will not fly its mission: "
                    f"{rejections[0]}.",
                    reasons=rejections,
                    remedy="Correct the plan and upload it again.",
                )
            return Uploaded(uploaded, all_differences)

    async def download(self, *, progress: ReportProgress | None = None) -> ItemsOnVehicle:
        """Reads mission, geofence and rally points."""
        with self._transfer("a download"):
            read = await self._read(_CombinedProgress(progress, 0), "Downloading")
            cached = self.items_on_vehicle or await self._find_stored(read.ids)
            same = cached is not None and not any(
                each.essential
                for part in PARTS
                for each in differences(part, cached.items[part], read.items[part])
            )
            self.items_on_vehicle = read
            if cached and same:
                self.items_on_vehicle = replace(read, plan=cached.plan, rejections=cached.rejections)
            return self.items_on_vehicle

    async def clear(self) -> None:
        """Clears mission, geofence and rally points on the vehicle."""
        with self._transfer("clearing"):
            for part in PARTS:
                await self._run_dialogue(Clear(self._target(), part), None)
            ids = await self._request_ids()
            empty: Items = {part: () for part in PARTS}
            self.items_on_vehicle = ItemsOnVehicle(
                empty, ids or dict.fromkeys(PARTS, 0), None, self._vehicle.clock.unix_s()
            )
            if ids is not None and any(ids.values()):
                raise Rejected(
                    f"Vehicle {self._vehicle.id} acknowledged, but still has items.",
                    remedy="Another station may have uploaded meanwhile.",
                )

    async def set_current(self, seq: int) -> None:
        """Sets the current mission item; returns once the vehicle reports it.

        Raises:
            NoReply: the vehicle does not report this item as current; PX4 does not answer for items that do
                not exist.
        """
        vehicle = self._vehicle
        vehicle.require("mission_transfer")
        identity = vehicle.identity
        request = d.MAVLink_mission_set_current_message(identity.system_id, identity.component_id, seq)
        reached = await self._request_current(lambda m: m.seq == seq, SET_CURRENT_DEADLINE_S, request)
        if reached is None:
            raise NoReply(
                f"Vehicle {vehicle.id} did not make item {seq + 1} the current one "
                f"within {SET_CURRENT_DEADLINE_S:g} s.",
                deadline_s=SET_CURRENT_DEADLINE_S,
                remedy="Check that its mission has this item, and the link.",
            )

    # --- internal -------------------------------------------------------------------------------------

    async def _restore(self) -> None:
        cached = await self._find_stored(self._searched_ids)
        if (
            cached is not None
            and self.items_on_vehicle is None
            and self._running_transfer is None
            and self.ids() == cached.ids
        ):
            self.items_on_vehicle = cached

    async def _find_stored(self, ids: Ids | None) -> ItemsOnVehicle | None:
        """The items that this vehicle had with these ids before a restart of the server."""
        if self._cache is None or ids is None or not any(ids.values()):
            return None
        return await self._cache.find(self._vehicle.identity.system_id, ids)

    @contextmanager
    def _transfer(self, transfer: str) -> Generator[None]:
        """Ensures that only one transfer runs at a time."""
        self._vehicle.require("mission_transfer")
        if self._running_transfer is not None:
            raise Refused(
                f"Vehicle {self._vehicle.id} is busy with {self._running_transfer}; "
                "only one can run at a time.",
                remedy="Wait until it is done, or cancel it.",
            )
        self._running_transfer = transfer
        try:
            yield
        finally:
            self._running_transfer = None

    async def _send_part(self, part: Part, items: Sequence[WireItem], report: _CombinedProgress) -> None:
        if not items:
            await self._run_dialogue(Clear(self._target(), part), None)
            return
        upload = Upload(self._target(), part, items)
        await self._run_dialogue(upload, report.for_dialogue(f"Sending the {NAME_OF[part]}"))
        report.add(len(items))
        if part == "mission":
            self.startable_s = self._vehicle.clock.monotonic_s() + STARTABLE_AFTER_S

    async def _read(self, report: _CombinedProgress, doing: str) -> ItemsOnVehicle:
        """Reads all three parts; repeats this once if the vehicle's ids changed meanwhile."""
        for _ in range(2):
            items: dict[Part, Sequence[WireItem]] = {}
            ids: Ids = {}
            for part in PARTS:
                download = Download(self._target(), part)
                await self._run_dialogue(download, report.for_dialogue(f"{doing} the {NAME_OF[part]}"))
                report.add(len(download.items))
                items[part], ids[part] = tuple(download.items), download.opaque_id or 0
            after = await self._request_ids()
            reports_ids = any(ids.values()) or not any(items.values())
            if after is None or after == ids or not reports_ids:
                return ItemsOnVehicle(items, after or ids, None, self._vehicle.clock.unix_s())
            report.restart()
        raise Rejected(
            f"The plan on vehicle {self._vehicle.id} changed twice while it was read.",
            remedy="Another station is uploading: wait until it is done.",
        )

    async def _read_rejections(self, sent_s: float) -> tuple[str, ...]:
        """Why the vehicle will not fly the mission that it received at `sent_s`: PX4 states it by events."""
        await asyncio.sleep(max(0.0, sent_s + REJECTED_WITHIN_S - self._vehicle.clock.monotonic_s()))
        await self._vehicle.health.receive_all_events()
        return tuple(dict.fromkeys(self._rejections.values()))

    async def _run_dialogue(self, dialogue: Dialogue, report: Callable[[Dialogue], None] | None) -> None:
        vehicle = self._vehicle
        matches = self._matches_dialogue(dialogue)
        with vehicle.mailbox.expect(*_MESSAGES, matches=matches) as waiter:
            try:
                self._send(dialogue.start(vehicle.clock.monotonic_s()))
                while not dialogue.done:
                    left_s = dialogue.wake_s - vehicle.clock.monotonic_s()
                    try:
                        async with asyncio.timeout(max(0.0, left_s)):
                            message = await waiter.next()
                    except TimeoutError:
                        self._send(dialogue.tick(vehicle.clock.monotonic_s()))
                        continue
                    self._send(dialogue.take(message, vehicle.clock.monotonic_s()))
                    if report is not None:
                        report(dialogue)
            except (NoReply, asyncio.CancelledError):
                await self._cancel(dialogue, waiter)
                raise

    async def _cancel(self, dialogue: Dialogue, waiter: Waiter) -> None:
        """Sends a cancel, and repeats it while the vehicle requests items: PX4 does not acknowledge it."""
        self._send(dialogue.cancel())
        end_s = self._vehicle.clock.monotonic_s() + CANCEL_LISTEN_S
        with suppress(TimeoutError, GcsError):
            while (left_s := end_s - self._vehicle.clock.monotonic_s()) > 0:
                async with asyncio.timeout(left_s):
                    await waiter.next()
                self._send(dialogue.cancel())

    async def _request_ids(self) -> Ids | None:
        """The ids that the vehicle currently reports; None if it reports no ids."""
        current = await self._request_current(lambda _: True, IDS_DEADLINE_S, None)
        return None if current is None else ids_of(current)

    async def _request_current(
        self, accepts: Callable[[Reply], bool], deadline_s: float, also_send: MAVLink_message | None
    ) -> Mission | None:
        """Sends `also_send` and requests MISSION_CURRENT until one is accepted; None at the deadline."""
        vehicle = self._vehicle
        identity = vehicle.identity
        request_current = Request(
            d.MAV_CMD_REQUEST_MESSAGE, (float(d.MAVLINK_MSG_ID_MISSION_CURRENT), 0, 0, 0, 0, 0, 0)
        )
        end_s = vehicle.clock.monotonic_s() + deadline_s
        with vehicle.mailbox.expect(
            d.MAVLINK_MSG_ID_MISSION_CURRENT, matches=self._is_from_vehicle
        ) as waiter:
            while (left_s := end_s - vehicle.clock.monotonic_s()) > 0:
                if also_send is not None:
                    vehicle.send(also_send)
                vehicle.send(request_current.message(identity.system_id, identity.component_id, 0, False))
                try:
                    async with asyncio.timeout(min(IDS_REQUEST_PERIOD_S, left_s)):
                        while not accepts(message := await waiter.next()):
                            pass
                        return mission_of(message)
                except TimeoutError:
                    continue
        return None

    def _target(self) -> Target:
        identity = self._vehicle.identity
        return Target(self._vehicle.id, identity.system_id, identity.component_id)

    def _send(self, messages: Sequence[MAVLink_message]) -> None:
        for message in messages:
            self._vehicle.send(message)

    def _is_from_vehicle(self, message: Reply) -> bool:
        identity = self._vehicle.identity
        return (message.get_srcSystem(), message.get_srcComponent()) == (
            identity.system_id,
            identity.component_id,
        )

    def _matches_dialogue(self, dialogue: Dialogue) -> Callable[[Reply], bool]:
        own_ids = self._vehicle.own_ids

        def matches(message: Reply) -> bool:
            target = (message.target_system, message.target_component)
            return dialogue.concerns(message) and self._is_from_vehicle(message) and target == own_ids

        return matches


class _CombinedProgress:
    """Combines the progress of several dialogues.

    Args:
        total: number of items of all dialogues; 0: unknown, so each dialogue reports its own fraction.
    """

    def __init__(self, progress: ReportProgress | None, total: int) -> None:
        self._progress = progress
        self._total = total
        self._before = 0

    def for_dialogue(self, text: str) -> Callable[[Dialogue], None]:
        """Progress function for one dialogue."""

        def report(dialogue: Dialogue) -> None:
            if self._progress is None:
                return
            count = dialogue.count
            fraction = None
            if self._total:
                fraction = (self._before + dialogue.transferred) / self._total
            elif count:
                fraction = dialogue.transferred / count
            text_with_item = (
                text if count is None else f"{text}: item {min(dialogue.transferred + 1, count)} of {count}"
            )
            self._progress(text_with_item, fraction)

        return report

    def add(self, count: int) -> None:
        """Counts transferred items."""
        self._before += count

    def restart(self) -> None:
        """Makes the total unknown, because all parts are read again."""
        self._total = 0
