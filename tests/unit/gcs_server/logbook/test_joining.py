"""Recordings, vehicles' logs and notes become flights: in any order, only if they surely belong together."""

import itertools
from dataclasses import replace

import pytest

from gcs_server.logbook.joining import Part, join
from gcs_server.logbook.logged_flights import LoggedFlight

ARMED = LoggedFlight(
    vehicle="1",
    uid=None,
    begin_s=20.0,
    end_s=140.0,
    begin_unix_s=1_795_000_000.0,
    by_gps=True,
    begin_boot_s=95.0,
    duration_s=120.0,
    distance_m=300.0,
    height_m=30.0,
    modes=("Mission",),
    failsafes=0,
    ended="landed",
    starts_armed=False,
)


def part(name, source, **changes):
    recordings = frozenset({f"{name}.tlog"} if source in ("recording", "notes") else ())
    recordings = changes.pop("recordings", recordings)
    return Part(f"{name}-0", name, source, replace(ARMED, **changes), recordings)


LOG = part("log", "vehicle", begin_s=1.0, end_s=121.5, duration_s=120.5)
RECORDING = part("recording", "recording", by_gps=False, begin_unix_s=ARMED.begin_unix_s + 1.2)
NOTES = part(
    "notes", "notes", begin_s=0.0, by_gps=False, begin_boot_s=None, recordings=frozenset({"recording.tlog"})
)


def ids(flights):
    return sorted(sorted(p.file for p in flight.parts) for flight in flights)


def test_recording_log_and_notes_are_one_flight_in_any_order():
    for parts in itertools.permutations((LOG, RECORDING, NOTES)):
        (flight,) = join(parts, {})
        assert [p.file for p in flight.parts] == ["log", "recording", "notes"]
        assert flight.id == "log-0"
        assert "time since its boot" in flight.why["log-0"]
        assert flight.why["notes-0"] == "recorded by this server"
        # 95 s since the boot are 1 s of the log and 20 s of the recording
        assert flight.offset_s(RECORDING) == pytest.approx(-19.0)
        assert flight.offset_s(LOG) == 0.0


@pytest.mark.parametrize(
    "changes",
    [
        {"vehicle": "2"},
        {"begin_boot_s": 300.0},  # another boot, at the same time: another vehicle with this id
        {"begin_unix_s": ARMED.begin_unix_s + 3600.0},
        {"begin_unix_s": ARMED.begin_unix_s + 3600.0, "begin_boot_s": None},
    ],
)
def test_another_vehicle_boot_or_time_is_another_flight(changes):
    assert len(join([LOG, part("other", "recording", **changes)], {})) == 2


def test_different_uids_are_different_vehicles_whatever_else_agrees():
    a, b = (part(name, "vehicle", uid=uid) for name, uid in (("a", "00aa"), ("b", "00bb")))
    assert len(join([a, b], {})) == 2


def test_two_vehicles_of_one_recording_each_get_their_log():
    recording = [
        Part(f"r-{n}", "r", "recording", replace(ARMED, vehicle=vehicle, by_gps=False))
        for n, vehicle in enumerate(("1", "2"))
    ]
    logs = [part(f"log{vehicle}", "vehicle", vehicle=vehicle) for vehicle in ("1", "2")]
    assert ids(join([*recording, *logs], {})) == [["log1", "r"], ["log2", "r"]]


def test_a_server_whose_clock_is_wrong_joins_by_boot_and_duration_and_says_so():
    late = part("late", "recording", by_gps=False, begin_unix_s=ARMED.begin_unix_s - 200.0)
    (flight,) = join([LOG, late], {})
    assert "clock of the server was wrong by 200 s" in flight.why["late-0"]
    hours = part("hours", "recording", by_gps=False, begin_unix_s=ARMED.begin_unix_s - 7200.0)
    flights = join([LOG, hours], {})
    assert len(flights) == 2
    assert "7200 s apart" in flights[0].unsure[0][1]
    known = [replace(each, flight=replace(each.flight, uid="00aa")) for each in (LOG, hours)]
    assert len(join(known, {})) == 1


def test_a_log_without_time_of_day_is_joined_only_with_the_only_flight_that_fits():
    timeless = part("timeless", "vehicle", begin_unix_s=None)
    assert len(join([timeless, RECORDING], {})) == 1
    again = part("again", "recording", by_gps=False, begin_unix_s=ARMED.begin_unix_s + 50_000.0)
    flights = join([timeless, RECORDING, again], {})
    assert len(flights) == 3
    (lone,) = [f for f in flights if f.parts[0].file == "timeless"]
    assert len(lone.unsure) == 2
    assert "several flights" in lone.unsure[0][1]
    assert len(join([timeless, part("x", "recording", duration_s=90.0)], {})) == 2


def test_simulators_that_arm_at_the_same_time_after_their_starts_keep_their_own_logs():
    """Two runs within minutes, with the same id and time since the boot."""
    logs = [part(f"log{n}", "vehicle", begin_unix_s=ARMED.begin_unix_s + 200.0 * n) for n in range(3)]
    recordings = [
        part(f"rec{n}", "recording", by_gps=False, begin_unix_s=ARMED.begin_unix_s + 200.0 * n + 0.5)
        for n in range(3)
    ]
    assert ids(join([*logs, *recordings], {})) == [[f"log{n}", f"rec{n}"] for n in range(3)]


def test_a_flight_goes_on_in_the_next_file_of_its_recording():
    first = part("first", "recording", ended="log_ends", duration_s=60.0, by_gps=False)
    then = part(
        "then",
        "recording",
        by_gps=False,
        starts_armed=True,
        begin_s=0.5,
        begin_boot_s=160.0,
        begin_unix_s=ARMED.begin_unix_s + 65.0,
        duration_s=55.0,
    )
    (flight,) = join([then, first], {})
    assert "gap of 5 s" in flight.why["then-0"]
    long_after = replace(then, flight=replace(then.flight, begin_boot_s=395.0))
    assert len(join([first, long_after], {})) == 2


def test_a_person_decides_and_it_stays():
    pair = frozenset((LOG.id, RECORDING.id))
    separated = join([LOG, RECORDING, NOTES], {pair: False, frozenset((LOG.id, NOTES.id)): False})
    assert ids(separated) == [["log"], ["notes", "recording"]]
    assert all(not flight.unsure for flight in separated)
    other = part("other", "recording", vehicle="1", begin_boot_s=4000.0, begin_unix_s=1.7e9)
    (joined,) = join([LOG, other], {frozenset((LOG.id, other.id)): True})
    assert joined.why["other-0"] == "joined by a person"


def test_an_unknown_vehicle_is_unsure():
    nameless = part("nameless", "file", vehicle="")
    flights = join([nameless, RECORDING], {})
    assert len(flights) == 2
    assert "the vehicle is not known" in flights[0].unsure[0][1]


def test_thousands_of_flights_are_joined_in_seconds():
    parts = [
        part(f"{kind}{n:04}", source, begin_unix_s=ARMED.begin_unix_s + 3000.0 * n, begin_boot_s=60.0 + n % 7)
        for n in range(1000)
        for kind, source in (("l", "vehicle"), ("r", "recording"))
    ]
    assert len(join(parts, {})) == 1000
