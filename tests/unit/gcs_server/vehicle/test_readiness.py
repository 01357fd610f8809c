"""Reasons against arming or flying a mode, from recorded reports of a real PX4."""

import gzip
import json
import lzma
import struct

import pytest

from gcs_server.mavlink.codec import FrameParser, full_payload
from gcs_server.mavlink.dialect import MAVLINK_MSG_ID_EVENT
from gcs_server.telemetry.wire import encode
from gcs_server.vehicle import event_document, readiness
from gcs_server.vehicle.event_stream import EventStream
from gcs_server.vehicle.px4.checks import CHECKS, MANUAL_CONTROL_ID, MODE_NEEDS
from gcs_server.vehicle.px4.events import ARMING_SUMMARY_ID, HEALTH_SUMMARY_ID, decode_event
from gcs_server.vehicle.px4.modes import BY_NAME
from gcs_server.vehicle.readiness import (
    MAX_CAUSES,
    MAX_FINDINGS,
    Finding,
    HealthReport,
    ReportJoiner,
    modes_and_component,
)
from tests.executed_lines import count_executed_lines

NO_GLOBAL_POSITION = "no valid global position"
NO_POSITION = "no valid position estimate"
NO_STICKS = "no RC transmitter or joystick"
NO_MISSION = "there is no mission to fly"
NO_SETPOINTS = "no offboard setpoints received"
NO_TAKEOFF = "this mode cannot take off from the ground"


def last_report(payloads, definitions=None):
    """The last report in a sequence of EVENT payloads."""
    return [None, *all_reports(payloads, definitions)][-1]


def all_reports(payloads, definitions=None):
    """All reports in a sequence of EVENT payloads."""
    joiner, reports = ReportJoiner(), []
    for payload in payloads:
        event = decode_event(payload, definitions)
        if event.id == ARMING_SUMMARY_ID:
            joiner.begin(event.arguments)
        elif event.id == HEALTH_SUMMARY_ID:
            reports.append(joiner.end(event.arguments))
        elif joiner.collecting:
            modes, component = modes_and_component(event.arguments)
            finding_fields = (event.id, event.name, event.level, modes, component, event.text, event.remedy)
            joiner.add(Finding(*finding_fields, event.arguments))
    return [r for r in reports if r is not None]


def event_payload(event_id, level, arguments=b""):
    return struct.pack("<IIHBBB40s", event_id, 0, 1, 0, 0, level, arguments)


def recorded_dialogues(shared, group):
    """(id, EVENT payloads) of each recorded dialogue with events."""
    for line in (shared / "px4/dialogues" / f"{group}.jsonl").read_text().splitlines():
        dialogue = json.loads(line)
        events = [r["fields"] for r in dialogue["received"] if r["msg"] == "EVENT" and "link" not in r]
        if events:
            yield (
                dialogue["id"],
                [
                    struct.pack(
                        "<IIHBBB40s",
                        *(e[k] for k in ("id", "event_time_boot_ms", "sequence")),
                        0,
                        0,
                        e["log_levels"],
                        bytes(e["arguments"]),
                    )
                    for e in events
                ],
            )


@pytest.fixture(scope="module")
def px4_definitions(reference_data):
    return event_document.parse(lzma.decompress((reference_data / "px4/events.json.xz").read_bytes()))


ARMING_CAUSES = {
    "nogps_prearm_checks": {
        "hold": {NO_POSITION, NO_GLOBAL_POSITION}, "position": {NO_POSITION, NO_STICKS},
        "mission": {NO_POSITION, NO_GLOBAL_POSITION, NO_MISSION}, "rtl": {NO_POSITION, NO_GLOBAL_POSITION},
        "offboard": {NO_SETPOINTS}, "stabilized": {NO_STICKS}, "manual": {NO_STICKS},
        "altitude": {NO_STICKS}, "land": {NO_POSITION}, "takeoff": {NO_POSITION},
    },
    "nogps_setmode_rtl": {
        "rtl": {NO_POSITION, NO_GLOBAL_POSITION, NO_TAKEOFF}, "land": {NO_TAKEOFF, NO_POSITION},
    },
    "lowbat_armed_wait": {"hold": {"the battery level is critical"}},
    "arm_in_mode_land": {
        "land": {NO_TAKEOFF}, "hold": set(), "position": {NO_STICKS}, "offboard": {NO_SETPOINTS},
    },
    "param_arm_arm_mis_req": {"hold": {NO_MISSION}, "position": {NO_MISSION, NO_STICKS}},
    "param_arm_two_mags_required": {"hold": {"too few compasses were found"}},
    "param_arm_odid_required": {"hold": {"the Open Drone ID system is missing"}},
    "air_flight_termination": {"hold": {"the flight was terminated"}},
    "offboard_disarmed_with_stream": {"offboard": set(), "hold": set(), "mission": {NO_MISSION}},
}  # fmt: skip
"""For each dialogue and mode: the causes that prevent arming."""
RUNNING_CAUSES = {
    "nogps_prearm_checks": {
        "hold": {NO_POSITION, NO_GLOBAL_POSITION},
        "offboard": {NO_SETPOINTS},
        "land": {NO_POSITION},
        "stabilized": {NO_STICKS},
    },
    "air_flight_termination": {"hold": set(), "mission": {NO_MISSION}},
    "setmode_disarmed_auto_external1": {"external_1": {"the external mode is not registered"}},
}
"""For each dialogue and mode: the causes that prevent flying in the mode."""


@pytest.mark.parametrize(("expected", "running"), [(ARMING_CAUSES, False), (RUNNING_CAUSES, True)])
def test_recorded_reports_have_the_expected_causes_for_each_mode(reference_data, expected, running):
    dialogues = {}
    for file in sorted((reference_data / "px4/dialogues").glob("*.jsonl")):
        for name, payloads in recorded_dialogues(reference_data, file.stem):
            dialogues.setdefault(name, payloads)
    for name, by_mode in expected.items():
        causes_of_reports = [
            {m: {f.cause for f in report.causes(BY_NAME[m].nav_state, running=running)} for m in by_mode}
            for report in all_reports(dialogues[name])
        ]
        assert by_mode in causes_of_reports, name


def test_every_recorded_report_explains_every_unavailable_mode(reference_data, px4_definitions):
    reports = 0
    for file in sorted((reference_data / "px4/dialogues").glob("*.jsonl")):
        for name, payloads in recorded_dialogues(reference_data, file.stem):
            for definitions in (None, px4_definitions):
                report = last_report(payloads, definitions)
                if report is None:
                    continue
                reports += 1
                view = readiness.readiness_of(report, 0.0, "own")
                assert len({m.mode for m in view.modes}) == len(view.modes) >= 14
                for mode in view.modes:
                    # the recorded vehicle had no external modes, which are shown only if they have a name
                    assert bool(mode.arming) != mode.can_arm, (name, mode.mode)
                    assert bool(mode.running) != mode.can_run, (name, mode.mode)
                for finding in view.findings:
                    assert finding.cause[0].isupper()
                    assert finding.cause.endswith((".", "!"))
                    assert "{" not in finding.cause + (finding.remedy or "")
                    assert "<" not in finding.cause + (finding.remedy or "")
                    assert finding.component is not None
                    assert not finding.name.startswith("event_"), finding
    assert reports > 40


def test_texts_of_the_vehicle_are_used_before_texts_of_the_server_and_contain_values(
    reference_data, px4_definitions
):
    name = "param_arm_two_mags_required"
    by_name = {}
    for dialogue, payloads in recorded_dialogues(reference_data, "command"):
        by_name[dialogue] = payloads
    for file in ("arming_denied", "param", "arming"):
        by_name |= dict(recorded_dialogues(reference_data, file))
    findings = last_report(by_name[name], px4_definitions).findings
    compass = next(f for f in findings if f.name == "check_mag_sys_has_mag_missing")
    assert compass.cause == "Found 1 compass (required: 2)"
    assert "SYS_HAS_MAG" in compass.remedy
    sticks = next(f for f in findings if f.id == MANUAL_CONTROL_ID)
    assert sticks.cause == "No manual control input"


def test_check_names_match_px4(px4_definitions):
    assert {i: check.name for i, check in CHECKS.items()} == {i: px4_definitions[i].name for i in CHECKS}
    mode_checks = {i for i, e in px4_definitions.items() if e.is_check and e.name.startswith("check_modes_")}
    assert mode_checks - set(MODE_NEEDS) == {18648929}  # take-off is denied, but the mode can be flown


def test_the_placeholders_of_an_event_text_are_replaced_by_the_arguments():
    document = {
        "version": 2,
        "components": {
            "0": {"namespace": "common", "enums": {"sides": {
                "type": "uint8_t", "is_bitfield": True,
                "entries": {"1": {"name": "l", "description": "Left"}, "4": {"name": "r"}},
            }}},
            "1": {"namespace": "px4", "enums": {"act": {
                "type": "uint8_t", "entries": {"1": {"name": "land", "description": "Land now!"}},
            }}, "event_groups": {"arming_check": {"events": {"7": {
                "name": "check_it", "message": r"At {1:.1m_v} of {2m/s}, \{x\} {3}: {4} {9}",
                "description": 'See <param>A_B</param>.\n\n<profile name="dev">Or <a>this</a>.</profile>',
                "arguments": [{"name": "a", "type": "float"}, {"name": "b", "type": "int16_t"},
                              {"name": "c", "type": "common::sides"}, {"name": "d", "type": "act"}],
            }, "8": {"name": "odd", "message": "{1} {2}", "arguments": [{"name": "a", "type": "matrix"},
                     {"name": "b", "type": "float"}]}}}}},
        },
    }  # fmt: skip
    definitions = event_document.parse(json.dumps(document))
    arguments = struct.pack("<fhBB", 12.345, -3, 5, 1).ljust(40, b"\0")
    check = definitions[1 << 24 | 7]
    assert check.text(arguments) == "At 12.3 m of -3 m/s, {x} Left, r: Land now! –"
    assert check.remedy(arguments) == "See A_B. Or this."
    assert definitions[1 << 24 | 8].text(arguments) == "– –"
    for invalid in ('{"version": 1}', "[]", "no json"):
        with pytest.raises(ValueError, match=r"."):
            event_document.parse(invalid)


def test_the_restrictions_of_all_chunks_apply_and_a_report_with_a_missing_chunk_is_dropped():
    def chunk(number, can_arm, errors, *checks):
        return [
            event_payload(
                ARMING_SUMMARY_ID, 0x88, struct.pack("<BIIII", number, errors, 0, can_arm, can_arm)
            ),
            *checks,
            event_payload(HEALTH_SUMMARY_ID, 0x88, struct.pack("<BIII", number, 1, 0, 0)),
        ]

    no_mission = event_payload(17154777, 0x66, struct.pack("<IB", 8, 20))
    unknown_event = event_payload(1 << 24 | 5, 0x33, struct.pack("<IB", 0xFFFFFFFF, 29))
    first, second = chunk(0, 0b11000, 1, no_mission), chunk(1, 0b10100, 2, unknown_event)
    report = last_report(first + second)
    assert (report.can_arm, report.errors, len(report.findings)) == (0b10000, 3, 2)
    assert [f.cause for f in report.causes(BY_NAME["mission"].nav_state)] == [
        "unknown event 16777221 from component 1 (autopilot)",
        NO_MISSION,
    ]
    assert readiness.readiness_of(report, 0, "own").findings[0].name == "event_16777221"
    assert last_report(second) is None
    assert last_report(first[1:]) is None
    joiner = ReportJoiner()
    joiner.begin(struct.pack("<BIIII", 0, 0, 0, 1, 1))
    joiner.discard()
    assert joiner.end(struct.pack("<BIII", 0, 0, 0, 0)) is None


def test_every_event_of_recorded_flights_has_a_text(reference_data, px4_definitions):
    """Every event of every telemetry log has a text, and every report explains the unavailable modes."""
    events = reports = 0
    for path in sorted((reference_data / "px4/tlogs").glob("*.tlog*")):
        content = gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes()
        stream, in_order, parser = EventStream(), [], FrameParser()
        for raw_frame in tlog_frames(content):
            for frame in parser.feed(raw_frame, 0.0):
                if frame.msg_id == MAVLINK_MSG_ID_EVENT:
                    event = full_payload(frame)
                    in_order += stream.take(int.from_bytes(event[8:10], "little"), event)
        assert stream.lost == 0, path.name
        for event in in_order:
            events += 1
            assert not decode_event(event, px4_definitions).name.startswith("event_"), path.name
        for report in all_reports(in_order, px4_definitions):
            reports += 1
            for mode in readiness.readiness_of(report, 0.0, "own").modes:
                assert bool(mode.arming) != mode.can_arm, (path.name, mode.mode)
                assert bool(mode.running) != mode.can_run, (path.name, mode.mode)
    assert events > 100
    assert reports > 20


def tlog_frames(content):
    """The frames of a telemetry log, without the eight bytes of time before each frame."""
    offset = 0
    while offset + 8 + 12 <= len(content):
        size = content[offset + 9] + 12
        yield content[offset + 8 : offset + 8 + size]
        offset += 8 + size


def long_finding(n):
    return Finding(n, "n" * 80, 3, 0x7FFFFFFF, "GPS", "c" * 1000, "r" * 1000, struct.pack("<I", n))


def hostile_report(chunks, findings):
    joiner, report = ReportJoiner(), None
    for chunk in range(chunks):
        joiner.begin(struct.pack("<BIIII", chunk, 0, 0, 0, 0))
        for n in range(findings):
            joiner.add(long_finding(n))
        report = joiner.end(struct.pack("<BIII", chunk, 0, 0, 0))
    return report


@pytest.mark.parametrize(("chunks", "findings"), [(1, 20_000), (250, 80)])
def test_a_too_long_report_is_cut_and_its_findings_are_counted(chunks, findings):
    report = hostile_report(chunks, findings)
    assert len(report.findings) == MAX_FINDINGS
    view = readiness.readiness_of(report, 0.0, "vehicle")
    assert view.left_out == f"The vehicle reported 20,000 findings; {MAX_FINDINGS} of them are shown."
    assert all(len(m.arming) <= MAX_CAUSES and len(m.running) <= MAX_CAUSES for m in view.modes)
    assert len(encode(view)) < 500_000
    assert count_executed_lines(lambda: readiness.readiness_of(report, 0.0, "vehicle")) < 60_000


def test_a_report_of_usual_length_is_complete():
    view = readiness.readiness_of(hostile_report(1, 3), 0.0, "own")
    assert view.left_out is None
    assert len(view.findings) == 3


@pytest.mark.parametrize(
    ("mode", "armed", "can_arm", "offered"),
    [
        ("offboard", False, ["hold", "position"], "hold"),
        ("land", False, ["position"], "position"),
        ("offboard", False, ["hold", "offboard"], None),
        ("offboard", True, ["hold"], None),
        ("offboard", None, ["hold"], None),
        ("offboard", False, ["acro"], None),
    ],
)
def test_if_a_mode_prevents_arming_another_mode_is_offered(mode, armed, can_arm, offered):
    report = HealthReport(sum(1 << BY_NAME[name].nav_state for name in can_arm), 0)
    offers = readiness.offers(report, BY_NAME[mode], armed)
    assert [(o.code, o.mode) for o in offers] == ([] if offered is None else [("choose_mode", offered)])
    assert all(o.label in o.text and BY_NAME[mode].label in o.text for o in offers)
