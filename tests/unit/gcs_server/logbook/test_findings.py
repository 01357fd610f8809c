"""Findings of logs: those of real vehicles are as the facts recorded beside them, healthy flights have none,
each
kind is found in values that show it, and damaged logs never break the search."""

import gzip
import json
from pathlib import Path

import numpy as np
import pytest

from gcs_server.logbook import columns, overview
from gcs_server.logbook.findings.table import KINDS, findings
from gcs_server.logbook.log import Log, Message, Span, Topic, UnreadableLog, VehicleStates
from gcs_server.logbook.tlog import read_tlog
from gcs_server.logbook.ulog import read_ulog
from tests.unit.gcs_server.logbook.faulty_flights import END_S, FAULTS, HEALTHY, between, flight, gps, topic
from tests.unit.gcs_server.logbook.generated_ulogs import mutated, ulog

RECORDINGS = Path(__file__).resolve().parents[5] / "shared" / "px4"


def recording(name):
    path = RECORDINGS / name
    if not path.exists():
        pytest.skip(f"the recording {name} is not beside this checkout")
    return path


def kinds(log):
    return {(each["kind"], each["severity"]) for each in findings(log)["findings"]}


def test_a_healthy_flight_of_a_real_px4_has_no_findings(tmp_path):
    path = tmp_path / "log.ulg"
    path.write_bytes(gzip.decompress(recording("logs/flight-short.ulg.gz").read_bytes()))
    facts = json.loads(recording("logs/flight-short.json").read_text())
    assert facts["dropouts"] == 0
    found = findings(read_ulog(path))
    assert found["findings"] == []
    assert {(each["kind"], each["reason"]) for each in found["not_judged"]} == {
        ("battery_resistance", "The current of the battery is not measured."),
        ("obstacle", "The topic obstacle_distance is not logged."),
    }


@pytest.mark.parametrize(
    ("name", "expected", "words"),
    [
        (
            "failsafe-battery.tlog",
            {"failsafe", "battery_charge"},
            ["Failsafe in Hold", "critically low", "to Land"],
        ),
        ("failsafe-datalink-rtl.tlog.gz", {"failsafe"}, ["connection to the ground station", "to Return"]),
        (
            "failsafe-geofence-rtl.tlog.gz",
            {"failsafe"},
            ["in Offboard", "geofence was violated", "Hold, Return"],
        ),
        ("failsafe-offboard-loss-act0.tlog", {"failsafe"}, ["setpoints in Offboard ended", "to Position"]),
        ("failsafe-offboard-loss-act3.tlog.gz", {"failsafe"}, ["setpoints in Offboard ended", "to Return"]),
        ("failsafe-offboard-loss-act5.tlog.gz", {"failsafe"}, ["setpoints in Offboard ended", "to Hold"]),
        ("offboard-api.tlog.gz", {"failsafe", "setpoint_gap"}, ["No setpoint", "245.191 sent none"]),
        ("flight-takeoff-reposition-orbit-gimbal-rtl.tlog.gz", set(), []),
        ("mission-pause-resume.tlog.gz", set(), []),
    ],
)
def test_recordings_of_a_real_px4_show_what_was_done_to_it(name, expected, words):
    found = findings(read_tlog(recording(f"tlogs/{name}")))["findings"]
    assert {each["kind"] for each in found} == expected
    text = " ".join(each["text"] for each in found)
    for word in words:
        assert word in text


def test_a_failsafe_is_compared_with_the_parameter_that_says_what_to_do():
    found = findings(read_tlog(recording("tlogs/failsafe-datalink-rtl.tlog.gz")))["findings"][0]
    assert found["limit"] == "NAV_DLL_ACT is 2: Return, as the vehicle did."
    assert found["panes"] == [["HEARTBEAT:2.1/custom_mode"]]


def test_a_healthy_flight_is_judged_and_has_no_finding():
    found = findings(HEALTHY)
    assert found["findings"] == []
    assert [each["kind"] for each in found["not_judged"]] == ["failsafe"]


@pytest.mark.parametrize("fault", FAULTS, ids="-".join)
def test_each_fault_is_found_and_nothing_else_is(fault):
    found = findings(FAULTS[fault])["findings"]
    assert {(each["kind"], each["severity"]) for each in found} | {fault} == {fault}, found
    assert fault in kinds(FAULTS[fault])
    for each in found:
        assert 0.0 <= each["begin_s"] <= each["end_s"] <= END_S + 2.0
        topics = {t.id: t for t in FAULTS[fault].topics}
        for field in (field for pane in each["panes"] for field in pane if "{" not in field):
            name, _, column = field.partition("/")
            assert column in topics[name].columns


def test_every_kind_has_a_fault_that_is_found():
    assert {kind for kind, _ in FAULTS} == {kind.name for kind in KINDS}


def test_a_failsafe_says_why_what_was_asked_for_and_what_happened():
    found = findings(FAULTS["failsafe", "warning"])["findings"][0]
    assert found["text"] == (
        "Failsafe in Mission: the connection to the ground station was lost. The battery had 15.60 V, 3.90 "
        "V a cell. "
        "The vehicle changed to Return."
    )
    assert found["limit"] == "NAV_DLL_ACT is 2: Return, as the vehicle did."
    other = flight(
        *FAULTS["failsafe", "warning"].topics, modes=[(0.0, 30.0, "Mission"), (30.0, 50.0, "Land")],
        failsafe=[(30.0, 50.0, "Failsafe")], parameters={"NAV_DLL_ACT": 2},
    )  # fmt: skip
    assert (
        findings(other)["findings"][0]["limit"] == "NAV_DLL_ACT is 2: Return, which the vehicle did not do."
    )


def test_a_gps_that_repeats_its_position_is_found():
    held = flight(gps(latitude_deg=lambda t: 47 + 1e-6 * np.sin(np.minimum(t, 30.0))))
    (found,) = findings(held)["findings"]
    assert found["text"] == "The GPS repeated one position for 20.0 s in the air."


def test_what_is_not_logged_is_named():
    reasons = {each["kind"]: each["reason"] for each in findings(flight())["not_judged"]}
    assert reasons["vibration"] == "The topic vehicle_imu_status is not logged."
    assert "link" not in reasons
    assert findings(flight())["findings"] == []


def test_only_the_vehicles_own_messages_of_a_recording_are_judged():
    states = [VehicleStates(name, [], [Span(0.0, END_S, "Armed")]) for name in ("1", "2")]
    log = Log("tlog", None, END_S, [
        topic("GPS_RAW_INT", 2, "1.1", fix_type=3, satellites_visible=12),
        topic("GPS_RAW_INT", 2, "2.1", fix_type=between(20, 30, 0, 3), satellites_visible=12),
    ], states)  # fmt: skip
    found = [each for each in findings(log)["findings"] if each["kind"] == "gps_quality"]
    assert [each["vehicle"] for each in found] == ["2"]


def test_a_kept_log_has_the_findings_of_the_file(tmp_path):
    (tmp_path / "log.ulg").write_bytes(ulog())
    read = read_ulog(tmp_path / "log.ulg")
    read.messages.append(Message(19.0, 2, "Geofence: approaching or outside geofence"))
    columns.write(read, overview.encode(read), tmp_path / "kept")
    kept = columns.load(tmp_path / "kept")
    assert findings(kept) == findings(read)
    assert (kept.duration_s, kept.parameters, kept.messages) == (
        read.duration_s,
        read.parameters,
        read.messages,
    )
    assert kept.dropouts == read.dropouts
    assert kept.parameter_changes == read.parameter_changes
    for one, other in zip(kept.topics, read.topics, strict=True):
        assert (one.id, one.units) == (other.id, other.units)
        for name, values in other.columns.items():
            np.testing.assert_array_equal(one.columns[name], values)


def hostile(rng, log):
    """The log with values that no vehicle has."""
    wild = np.array([np.nan, np.inf, -np.inf, 1e300, -1e300, 0.0, -1.0, 1e9, 255.0, 2.0**63])
    damaged = []
    for each in log.topics:
        values = {}
        for name, column in each.columns.items():
            kind = rng.integers(5)
            if kind == 0:
                values[name] = rng.choice(wild, column.shape)
            elif kind == 1:
                values[name] = np.where(
                    rng.random(column.shape) < 0.1, rng.choice(wild, column.shape), column
                )
            elif kind == 2:
                values[name] = np.full(column.shape, rng.choice(wild))
            elif kind == 3:
                values[name] = column
        times_s = each.times_s
        if rng.random() < 0.3:  # the clock jumps, stands still or the topic ends early
            times_s = np.sort(rng.choice([0.0, 1.0, 30.0, 6e5], times_s.shape) + rng.random(times_s.shape))
        keep = slice(0, int(rng.choice([1, 2, 3, len(times_s)])))
        if values:
            damaged.append(
                Topic(each.name, each.instance, times_s[keep], {k: v[keep] for k, v in values.items()}, {})
            )
    parameters = {
        name: float(rng.choice(wild[5:])) for name in ("COM_OF_LOSS_T", "BAT1_N_CELLS", "GF_MAX_HOR_DIST")
    }
    return Log(
        log.kind, None, log.duration_s, damaged, log.vehicles, parameters=parameters, dropouts=[(np.nan, 1.0)]
    )


@pytest.mark.parametrize(
    "seed", [*range(8), *(pytest.param(seed, marks=pytest.mark.broad) for seed in range(8, 100))]
)
def test_hostile_values_never_break_the_search(seed):
    rng = np.random.default_rng(seed)
    for log in (HEALTHY, *FAULTS.values()):
        found = findings(hostile(rng, log))
        for each in found["findings"]:
            assert np.isfinite((each["begin_s"], each["end_s"])).all()
            assert "nan" not in each["text"]
            assert "inf" not in each["text"].replace("information", "")


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.broad) for seed in range(1, 50))])
def test_damaged_files_never_break_the_search(tmp_path, seed):
    path = tmp_path / "log.ulg"
    for k in range(100):
        path.write_bytes(mutated(ulog(steps=40), 1000 * seed + k))
        try:
            log = read_ulog(path)
        except UnreadableLog:
            continue
        found = findings(log)
        json.dumps(found)
