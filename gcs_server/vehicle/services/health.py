"""Puts a vehicle's events in order, and collects its arming and health report from them.

Lost events are requested again (`event_stream.py`). A report consists of several events in order
(`readiness.py`). The server requests the report when the vehicle connects, because PX4 sends it only after a
change.
"""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

from gcs_server.errors import NoReply
from gcs_server.mavlink import dialect as d
from gcs_server.vehicle import readiness
from gcs_server.vehicle.event_definitions import Definitions
from gcs_server.vehicle.event_stream import EventStream
from gcs_server.vehicle.px4.checks import CHECKS
from gcs_server.vehicle.px4.events import (
    ARMING_SUMMARY_ID,
    HEALTH_SUMMARY_ID,
    LEVEL_PROTOCOL,
    TEXTS,
    VehicleEvent,
    decode_event,
    describe,
    has_description,
)
from gcs_server.vehicle.px4.modes import BY_CUSTOM_MODE
from gcs_server.vehicle.readiness import Finding, HealthReport, Readiness, ReportJoiner
from gcs_server.vehicle.samples import Health
from gcs_server.vehicle.services.metadata import MetadataService
from gcs_server.vehicle.services.port import VehiclePort

FIRST_REQUEST_AFTER_S = 2.0
"""Time for which the server waits for a report before it requests one [s]."""
REQUEST_PERIOD_S, MAX_REQUESTS = 2.0, 4
RESTART_S = 10.0
"""If the boot clock goes back by more than this, the vehicle has restarted [s]."""
CHECK_RESEND_S, CHECK_DEADLINE_S = 0.7, 5.0
ALL_EVENTS_RESEND_S, ALL_EVENTS_DEADLINE_S = 0.25, 2.0
REPORT_PERIOD_S = 0.25
"""Minimum time between two published changes of the report [s]."""
DEFINITIONS_RETRY_S, MAX_DEFINITIONS_RETRY_S = 30.0, 960.0
"""Time after a failure until the vehicle's event definitions are requested again, doubled after each failure,
and its maximum [s]."""
DESCRIPTION_TIMEOUT_S = 5.0
"""Maximum time for which an event waits for a description [s]."""

_current = struct.Struct("<HB")
_error = struct.Struct("<HH")


class HealthService:
    """Health of one vehicle.

    Args:
        vehicle: the vehicle.
        publish_event: called with each event outside reports, and whether the event was lost and requested
            again.
        fetch_definitions: starts `read_definitions` in the background.
    """

    def __init__(
        self,
        vehicle: VehiclePort,
        publish_event: Callable[[VehicleEvent, bool], None],
        fetch_definitions: Callable[[], None] = lambda: None,
    ) -> None:
        self._vehicle = vehicle
        self._publish_event = publish_event
        self._stream: EventStream[VehicleEvent] = EventStream()
        self._joiner = ReportJoiner()
        self._report: HealthReport | None = None
        self._published: Readiness = readiness.NOTHING_KNOWN
        self._published_s = float("-inf")
        self._unpublished_unix_s: float | None = None
        """Time of a report that is not yet in `_published`."""
        self._fetch_definitions = fetch_definitions
        self._reading_definitions = False
        self._next_reading_s = float("-inf")
        self._definitions_retry_s = DEFINITIONS_RETRY_S
        self._definitions: Definitions | None = None
        self._newest_boot_ms = 0
        self._report_count = 0
        self._requests_sent = 0
        self._next_request_s = float("inf")
        self.revision = 0
        """Number of changes of `readiness`."""
        self.changed_s: float | None = None
        """Time of the last change [s, monotonic]; None before the first change."""

    @property
    def report(self) -> HealthReport | None:
        """The newest complete report."""
        return self._report

    @property
    def readiness(self) -> Readiness:
        """The newest report with texts."""
        if self._unpublished_unix_s is not None:
            self._publish()
        return self._published

    @property
    def prevents_arming(self) -> bool:
        """Whether the vehicle reports that it cannot be armed now, neither in its mode nor in another one.

        After a landing PX4 stays in Offboard and is not ready in it; the start of a flight changes the mode.
        """
        health = self._vehicle.topic("health")
        if health is None or not isinstance(health.value, Health) or health.value.ready_to_arm is not False:
            return False
        mode = BY_CUSTOM_MODE.get(self._vehicle.flight_state.custom_mode)
        if self._report is None:  # as over ROS 2: only that it is not ready in its mode
            return mode is None or mode.name != "offboard"
        return not self._offers()

    @property
    def missing(self) -> bool:
        """Whether missing events may still arrive."""
        return self._stream.missing is not None

    def arming_problems(self, nav_state: int | None) -> tuple[str, ...]:
        """Reasons why the vehicle cannot arm in a mode (None: any mode); empty if it can arm, or
        if unknown."""
        report = self._report
        if report is None:
            return ()
        findings = report.findings if nav_state is None else report.causes(nav_state)
        return tuple(f.cause for f in findings)

    def apply_definitions(self, definitions: Definitions) -> None:
        """Uses the vehicle's event definitions for all texts, also for those of the current report."""
        self._definitions = definitions
        if self._report is not None:
            findings = tuple(self._described(f) for f in self._report.findings)
            self._set_report(replace(self._report, findings=findings))

    async def read_definitions(self, metadata: MetadataService) -> None:
        """Reads the event definitions from the vehicle's metadata; raises the errors of `metadata.events`."""
        if self._definitions is not None:
            self._reading_definitions = False
            return
        self._reading_definitions = True
        try:
            self.apply_definitions(await metadata.events())
        finally:
            self._reading_definitions = False
            self._next_reading_s = self._vehicle.clock.monotonic_s() + self._definitions_retry_s
            self._definitions_retry_s = min(self._definitions_retry_s * 2, MAX_DEFINITIONS_RETRY_S)

    def describe_again(self, event: VehicleEvent, waited_s: float) -> VehicleEvent | None:
        """Adds the description to an event without one; None if the description may still arrive."""
        text, name, remedy = describe(event.id, event.arguments, self._definitions)
        is_described = has_description(event.id, self._definitions)
        if not is_described and self._reading_definitions and waited_s < DESCRIPTION_TIMEOUT_S:
            return None
        return replace(event, text=text, name=name, remedy=remedy, is_described=is_described)

    async def check(self) -> Readiness:
        """Requests that the vehicle runs its checks, and returns the report.

        Raises:
            NoReply: no report was received.
        """
        vehicle = self._vehicle
        vehicle.require("arming_report")
        before, deadline_s = self._report_count, vehicle.clock.monotonic_s() + CHECK_DEADLINE_S
        with vehicle.mailbox.expect(d.MAVLINK_MSG_ID_EVENT) as waiter:
            while (left_s := deadline_s - vehicle.clock.monotonic_s()) > 0:
                self._request()
                try:
                    async with asyncio.timeout(min(CHECK_RESEND_S, left_s)):
                        while self._report_count == before:
                            await waiter.next()
                except TimeoutError:
                    continue
                return self.readiness
        raise NoReply(
            f"Vehicle {vehicle.id} did not report its checks within {CHECK_DEADLINE_S:g} s.",
            deadline_s=CHECK_DEADLINE_S,
            remedy="Check the link; only PX4 reports its arming checks.",
        )

    async def receive_all_events(self) -> None:
        """Returns when no event is outstanding, or at the deadline.

        Asks for the next event: the vehicle repeats it if it was lost, or states that it has no such event.
        """
        vehicle = self._vehicle
        end_s = vehicle.clock.monotonic_s() + ALL_EVENTS_DEADLINE_S
        with vehicle.mailbox.expect(d.MAVLINK_MSG_ID_EVENT, d.MAVLINK_MSG_ID_RESPONSE_EVENT_ERROR) as waiter:
            while (expected := self._stream.expected) is not None and (
                left_s := end_s - vehicle.clock.monotonic_s()
            ) > 0:
                self._send_event_request(expected, expected)
                with suppress(TimeoutError):
                    async with asyncio.timeout(min(ALL_EVENTS_RESEND_S, left_s)):
                        while self._stream.expected == expected:
                            message = await waiter.next()
                            is_error = message.get_msgId() == d.MAVLINK_MSG_ID_RESPONSE_EVENT_ERROR
                            if is_error and message.sequence == expected and not self.missing:
                                return

    # --- called by the vehicle only -------------------------------------------------------------------

    def take_event(self, payload: bytes) -> None:
        """Handles EVENT."""
        event = decode_event(payload, self._definitions)
        if self._newest_boot_ms - event.boot_ms > RESTART_S * 1e3 and not self._stream.is_missing(
            event.sequence
        ):
            self._reset_after_restart()
        late = self._stream.is_missing(event.sequence)
        self._newest_boot_ms = max(self._newest_boot_ms, event.boot_ms)
        lost = self._stream.lost
        ready = self._stream.take(event.sequence, event)
        if not self._is_in_report(event):
            self._request_definitions(event)
            self._publish_event(event, late)
        self._process_in_order(ready, lost)
        self._request_missing_events()

    def take_sequence(self, payload: bytes) -> None:
        """Handles CURRENT_EVENT_SEQUENCE."""
        lost = self._stream.lost
        self._stream.current(*_current.unpack_from(payload))
        self._process_in_order([], lost)
        self._request_missing_events()

    def take_event_error(self, payload: bytes) -> None:
        """Handles RESPONSE_EVENT_ERROR."""
        sequence, oldest = _error.unpack_from(payload)
        lost = self._stream.lost
        self._process_in_order(self._stream.skip_unavailable(sequence, oldest), lost)

    def connected(self) -> None:
        """Requests the report unless the vehicle sends one; called when the vehicle has connected."""
        self._requests_sent, self._next_request_s = (
            0,
            self._vehicle.clock.monotonic_s() + FIRST_REQUEST_AFTER_S,
        )

    def tick(self) -> None:
        """Requests missing events and reports, and publishes changes; called a few times a second."""
        now_s = self._vehicle.clock.monotonic_s()
        if self._stream.missing is not None:
            lost = self._stream.lost
            self._process_in_order(self._stream.give_up(now_s), lost)
            self._request_missing_events()
        if self._report is not None and (
            self._unpublished_unix_s is not None or self._offers() != self._published.offers
        ):
            self._publish()
        if now_s < self._next_request_s:
            return
        identity = self._vehicle.identity
        self._next_request_s = now_s + REQUEST_PERIOD_S
        if self._requests_sent >= MAX_REQUESTS or identity.replayed or not identity.commandable:
            self._next_request_s = float("inf")
            return
        if self._report is not None and self._requests_sent == 0 and self._report_is_recent():
            self._next_request_s = float("inf")
            return
        self._requests_sent += 1
        self._request()

    def _report_is_recent(self) -> bool:
        reported = self._published.reported_unix_s
        return reported is not None and self._vehicle.clock.unix_s() - reported < 2 * FIRST_REQUEST_AFTER_S

    def _count_change(self) -> None:
        self.revision += 1
        self.changed_s = self._vehicle.clock.monotonic_s()

    def _reset_after_restart(self) -> None:
        self._stream.reset()
        self._joiner.discard()
        self._newest_boot_ms = 0
        self._report, self._published, self._unpublished_unix_s = None, readiness.NOTHING_KNOWN, None
        self._count_change()
        self.connected()

    def _request_definitions(self, event: VehicleEvent) -> None:
        """Requests the vehicle's event definitions at the first event without a description."""
        identity = self._vehicle.identity
        if event.is_described or event.level >= LEVEL_PROTOCOL or self._definitions is not None:
            return
        now_s = self._vehicle.clock.monotonic_s()
        if (
            self._reading_definitions
            or now_s < self._next_reading_s
            or identity.replayed
            or not identity.commandable
        ):
            return
        self._reading_definitions = True  # `read_definitions` resets it at its end
        self._fetch_definitions()

    def _request_missing_events(self) -> None:
        if self._vehicle.identity.replayed:
            return
        missing = self._stream.next_request(self._vehicle.clock.monotonic_s())
        if missing is not None:
            self._send_event_request(*missing)

    def _send_event_request(self, first: int, last: int) -> None:
        identity = self._vehicle.identity
        self._vehicle.send(
            d.MAVLink_request_event_message(identity.system_id, identity.component_id, first, last)
        )

    def _request(self) -> None:
        identity = self._vehicle.identity
        self._vehicle.send(
            d.MAVLink_command_long_message(
                identity.system_id, identity.component_id, d.MAV_CMD_RUN_PREARM_CHECKS, 0, *(0.0,) * 7
            )
        )

    def _is_in_report(self, event: VehicleEvent) -> bool:
        if event.id in (ARMING_SUMMARY_ID, HEALTH_SUMMARY_ID):
            return True
        if self._definitions is not None and event.id in self._definitions:
            return self._definitions[event.id].is_check
        return event.id in CHECKS or (event.id not in TEXTS and self._joiner.collecting)

    def _process_in_order(self, events: list[VehicleEvent], lost_before: int) -> None:
        if self._stream.lost != lost_before:
            self._joiner.discard()
            self._requests_sent, self._next_request_s = (
                0,
                min(self._next_request_s, self._vehicle.clock.monotonic_s() + 0.5),
            )
        for event in events:
            if event.id == ARMING_SUMMARY_ID:
                self._joiner.begin(event.arguments)
            elif event.id == HEALTH_SUMMARY_ID:
                report = self._joiner.end(event.arguments)
                if report is not None:
                    self._report_count += 1
                    self._requests_sent, self._next_request_s = 0, float("inf")
                    self._set_report(report)
            elif self._is_in_report(event):
                modes, component = readiness.modes_and_component(event.arguments)
                self._joiner.add(
                    Finding(
                        event.id, event.name, event.level, modes, component, event.text, event.remedy,
                        event.arguments,
                    )
                )  # fmt: skip

    def _described(self, finding: Finding) -> Finding:
        text, name, remedy = describe(finding.id, finding.arguments, self._definitions)
        return replace(finding, cause=text, name=name, remedy=remedy)

    def _set_report(self, report: HealthReport) -> None:
        clock = self._vehicle.clock
        text_source = "vehicle" if self._definitions is not None else "own"
        if (
            self._unpublished_unix_s is None
            and readiness.is_unchanged(report, self._report)
            and text_source == self._published.words
        ):
            self._published = replace(self._published, reported_unix_s=clock.unix_s())
            return
        self._report, self._unpublished_unix_s = report, clock.unix_s()
        if clock.monotonic_s() - self._published_s >= REPORT_PERIOD_S:
            self._publish()

    def _offers(self) -> tuple[readiness.Offer, ...]:
        flight_state = self._vehicle.flight_state
        return readiness.offers(
            self._report, BY_CUSTOM_MODE.get(flight_state.custom_mode), flight_state.armed
        )

    def _publish(self) -> None:
        """Adds texts to the newest report, and publishes an event that the report has changed."""
        report = self._report
        assert report is not None
        now_s = self._vehicle.clock.unix_s()
        text_source = "vehicle" if self._definitions is not None else "own"
        unusable_texts = None if self._definitions is None else self._definitions.omission_text
        reported_unix_s = self._unpublished_unix_s or self._published.reported_unix_s or now_s
        readiness_now = readiness.readiness_of(report, reported_unix_s, text_source, unusable_texts)
        label_of = self._vehicle.mode_names.name_or_label
        modes = tuple(replace(each, label=label_of(each.mode, each.label)) for each in readiness_now.modes)
        self._published = replace(readiness_now, modes=modes, offers=self._offers())
        self._unpublished_unix_s, self._published_s = None, self._vehicle.clock.monotonic_s()
        self._count_change()
        mode = BY_CUSTOM_MODE.get(self._vehicle.flight_state.custom_mode)
        self._vehicle.events.add(
            "readiness",
            now_s,
            "The vehicle's checks have changed",
            severity=d.MAV_SEVERITY_DEBUG,
            data={
                "revision": self.revision,
                "mode": mode.name if mode is not None else None,
                "can_arm": None if mode is None else bool(report.can_arm >> mode.nav_state & 1),
            },
            stored=False,
        )
