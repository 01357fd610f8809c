"""Sends status texts and events; REQUEST_EVENT repeats missed events."""

from __future__ import annotations

from typing import Any

from vehicle_sim.autopilot.announcer import Event, StatusText
from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import Message
from vehicle_sim.mavlink.link import Link

CHUNK_LENGTH = 50
MAX_REPEATED_EVENTS = 101
"""Maximum number of events repeated for one request."""
RESET = 1
"""Flag of CURRENT_EVENT_SEQUENCE."""


class TextService:
    """Sends STATUSTEXT, EVENT and CURRENT_EVENT_SEQUENCE, and handles REQUEST_EVENT."""

    def __init__(self, context: Context) -> None:
        self._context = context
        context.autopilot.announcer.add_listener(self._send)
        self.handlers = {"REQUEST_EVENT": self.request}

    def _send(self, announcement: StatusText | Event) -> None:
        if isinstance(announcement, Event):
            self._context.broadcast("EVENT", **_event_fields(announcement))
            return
        text = announcement.text
        chunks = [text[start : start + CHUNK_LENGTH] for start in range(0, len(text), CHUNK_LENGTH)] or [""]
        for link in self._context.links:
            if not self._context.gcs_connected(link):
                continue
            for chunk_seq, chunk in enumerate(chunks):
                link.send(
                    "STATUSTEXT", severity=announcement.severity, text=chunk, chunk_seq=chunk_seq,
                    id=announcement.id,
                )  # fmt: skip

    def request(self, link: Link, message: Message) -> None:
        """Repeats requested events; replies with RESPONSE_EVENT_ERROR for each event that is not stored."""
        if not self._context.addresses_autopilot(message):
            return
        recent = self._context.autopilot.announcer.recent
        stored = {event.sequence: event for event in recent}
        oldest = recent[0].sequence if recent else 0
        count = 1 + ((message.last_sequence - message.first_sequence) & 0xFFFF)
        for offset in range(min(count, MAX_REPEATED_EVENTS)):
            sequence = (message.first_sequence + offset) & 0xFFFF
            if sequence in stored:
                link.send("EVENT", **_event_fields(stored[sequence]))
            else:
                link.send(
                    "RESPONSE_EVENT_ERROR", target_system=message.system_id,
                    target_component=message.component_id, sequence=sequence,
                    sequence_oldest_available=oldest,
                )  # fmt: skip

    def send_current_sequence(self, link: Link, flags: int = 0) -> None:
        """Sends CURRENT_EVENT_SEQUENCE, so that a receiver can detect a gap."""
        sequence = self._context.autopilot.announcer.sequence
        link.send("CURRENT_EVENT_SEQUENCE", sequence=sequence, flags=flags)

    def start_event_sequence(self, link: Link) -> None:
        """Sends CURRENT_EVENT_SEQUENCE with RESET; called when a ground station first connects on a link."""
        self.send_current_sequence(link, RESET)


def _event_fields(event: Event) -> dict[str, Any]:
    return {
        "id": event.id,
        "event_time_boot_ms": event.time_boot_ms,
        "sequence": event.sequence,
        "log_levels": event.log_levels,
        "arguments": event.arguments,
    }
