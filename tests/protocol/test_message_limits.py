"""Too many texts, reports and unknown events of a vehicle: the server limits their number and reports
how many it dropped."""

import struct

import pytest

from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import encode_payload
from gcs_server.vehicle import metadata_files
from gcs_server.vehicle.event_logger import (
    MAX_BURST_LINES,
    MAX_CHUNKS,
    MAX_LINES_PER_S,
    MAX_PENDING,
    TextJoiner,
)
from gcs_server.vehicle.px4.events import TEXTS
from gcs_server.vehicle.services.health import DESCRIPTION_TIMEOUT_S
from tests.protocol.memory_testbed import MemoryTestbed
from tests.protocol.one_vehicle import HOLD_MODE_BIT, run_scenario, send_arming_report
from tests.protocol.simulated_autopilot import SimulatedAutopilot
from vehicle_sim.storage.metadata import EVENTS, built_in

UNKNOWN_EVENT = 17980399
METADATA_ID = d.MAVLINK_MSG_ID_COMPONENT_METADATA
STATUSTEXT = struct.Struct("<B50sHB")
"""Severity, text, text id, chunk number."""


def event_payload(event_id, sequence, arguments=b"", level=6):
    return encode_payload(
        d.MAVLink_event_message(0, 0, event_id, 900_000, sequence, level, list(arguments.ljust(40, b"\0")))
    ).ljust(53, b"\0")


def event_texts(vehicle, *kinds):
    return [e.text for e in vehicle.events.since(0) if e.kind in kinds]


def test_frequently_changing_reports_are_shown_a_few_times_a_second_and_the_last_report_remains(
    run_simulated,
):
    async def scenario(testbed, vehicle, autopilot):
        reports = []
        vehicle.events.subscribe(lambda e: reports.append(e) if e.kind == "readiness" else None)
        for n in range(2000):
            send_arming_report(autopilot, HOLD_MODE_BIT if n % 2 else 0, present=n)
        await testbed.clock.sleep(1)
        assert 1 <= len(reports) <= 5
        assert [m.can_arm for m in vehicle.health.readiness.modes if m.mode == "hold"] == [True]

    run_scenario(run_simulated, scenario)


def test_the_first_event_without_text_triggers_a_download_of_the_metadata(run_simulated):
    async def run():
        testbed = MemoryTestbed()
        autopilot = SimulatedAutopilot(testbed.link())
        try:
            vehicle = await testbed.wait_for_vehicle()

            async def run_inline(function):
                return function()

            async def read_inline(kind, packed, crc):
                return metadata_files.decode_document(kind, metadata_files.encode_document(kind, packed, crc))

            vehicle.metadata.run_in_thread, vehicle.metadata.read = run_inline, read_inline
            definitions = metadata_files.decode_document(
                metadata_files.EVENTS,
                metadata_files.encode_document(metadata_files.EVENTS, built_in()[EVENTS](), 0),
            )
            event_id = next(
                i for i, e in definitions.items() if i not in TEXTS and not e.is_check and not e.arguments
            )
            sequence = vehicle.health._stream.expected
            vehicle.health.take_event(event_payload(event_id, sequence))
            await testbed.clock.sleep(DESCRIPTION_TIMEOUT_S + 1)
            assert event_texts(vehicle, "event")[-1] == definitions[event_id].text(bytes(40))
        finally:
            autopilot.alive = False
            await testbed.close()

    run_simulated(run)


def test_the_text_of_an_event_without_description_names_its_component(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        for _ in range(100):
            autopilot.send_event(UNKNOWN_EVENT, 0x66)
            await testbed.clock.sleep(1)
        texts = event_texts(vehicle, "event")
        assert set(texts) == {f"unknown event {UNKNOWN_EVENT} from component 1 (autopilot)"}
        assert len(texts) >= 95
        requests = [
            m for m in autopilot.received_commands(d.MAV_CMD_REQUEST_MESSAGE) if m.param1 == METADATA_ID
        ]
        # The server reads the metadata up to three times, each time with up to 6 requests.
        assert 1 <= len(requests) <= 3 * 6

    run_scenario(run_simulated, scenario)


def test_a_status_text_describes_an_event_without_metadata(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        autopilot.send_event(99999, 0x44)
        autopilot.send_text("The event's text\t", 4)
        await testbed.clock.sleep(2)
        assert event_texts(vehicle, "event", "status_text") == ["The event's text"]

    run_scenario(run_simulated, scenario)


def test_a_hundred_thousand_texts_are_limited_and_the_number_of_dropped_texts_is_shown(run_simulated):
    async def scenario(testbed, vehicle, autopilot):
        for n in range(100_000):
            vehicle._event_logger.text(STATUSTEXT.pack(4, b"text %d" % n, 0, 0), "link")
        await testbed.clock.sleep(5)
        texts = event_texts(vehicle, "status_text")
        assert len(texts) <= MAX_BURST_LINES + MAX_LINES_PER_S * 5
        (warning,) = [text for text in event_texts(vehicle, "warning") if "too many messages" in text]
        assert f"{100_000 - len(texts):,}" in warning
        autopilot.send_text("The next text", 4)
        await testbed.clock.sleep(1)
        assert event_texts(vehicle, "status_text")[-1] == "The next text"

    run_scenario(run_simulated, scenario)


@pytest.mark.parametrize("chunk", [0, 7, 19, 255])
def test_endless_chunks_take_limited_memory_and_become_texts_of_limited_length(chunk):
    joiner, texts = TextJoiner(), []
    for text_id in range(1, 65536):
        texts += joiner.feed(STATUSTEXT.pack(4, b"x" * 50, text_id, chunk), 0.0)
        assert len(joiner._pending) <= MAX_PENDING
    # 50 bytes for each chunk, and the marks of lost chunks.
    assert all(len(text) <= MAX_CHUNKS * 50 + 10 for _, text in texts)
