"""After seeking in a log, the state of a vehicle is the same as after playing the log up to that time."""

import asyncio

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gcs_server.links.base import Link, Peer
from gcs_server.replay.index import MODE_COMMANDS, make_index
from gcs_server.replay.playback import ReplayClock, condense, state_at
from gcs_server.replay.records import Batch, Cursor, open_log, read_batch
from gcs_server.vehicle import mode_cause
from gcs_server.vehicle.samples import TOPICS
from tests.protocol.memory_testbed import MemoryTestbed
from tests.unit.gcs_server.replay.generated_logs import flight, log_bytes


class FakeReplayLink(Link):
    """A link that receives the records of a log as `TlogLink` does."""

    replay = True

    def __init__(self, begin_us):
        super().__init__("replay", "replay")
        self.clock = ReplayClock(begin_us, 0)

    def _open(self):
        self._peers["log"] = Peer("log")
        self._opened()

    def _close(self):
        pass

    def _writer(self, peer):
        return None

    def feed(self, record):
        self.clock.time_us = record.time_us
        self._received(record.raw, self._peers["log"], self.clock.monotonic_s())


def states_after(records, until_us, begin_us, *, with_ticks):
    """The state of each vehicle after these records; `with_ticks`: the fleet also ticks every 250 ms."""

    async def scenario():
        testbed = MemoryTestbed()
        link = FakeReplayLink(begin_us)
        testbed.router.add(link)
        tick_us = begin_us
        for record in records:
            while with_ticks and record.time_us - tick_us > 250_000:
                tick_us += 250_000
                testbed.fleet.tick()
            link.feed(record)
        link.clock.time_us = until_us
        testbed.fleet.tick()
        states = {vehicle.id: state_of(vehicle) for vehicle in testbed.fleet.all()}
        await testbed.close()
        return states

    return asyncio.run(scenario())


def state_of(vehicle):
    topics = {name: vehicle.topic(name) for name in TOPICS}
    events = [(round(e.unix_s, 3), e.kind, e.severity, e.text) for e in vehicle.events.since()]
    # After seeking, links and components connect at the first record that is fed.
    compared_events = sorted(e for e in events if e[1] not in ("link", "component"))
    return vehicle.identity, vehicle.flight_state, vehicle.health.report, topics, compared_events


def all_records(file):
    batch, records = Batch([], Cursor(), at_end=False, bytes_skipped=0), []
    while not batch.at_end:
        batch = read_batch(file, batch.after)
        records += batch.records
    return records


def compare_seeking_with_playing(path, fraction):
    """Compares seeking to this fraction of the log with playing up to the same time.

    Returns:
        The states of the vehicles, the number of played records, and the number of records fed after seeking.
    """
    with open_log(path) as file:
        index = make_index(file)
        until_us = index.begin_us + int((index.end_us - index.begin_us) * fraction)
        records = all_records(file)
        played_records = [r for r in records if r.time_us <= until_us]
        seek_state = state_at(file, index, until_us)
        after_seeking = states_after(seek_state.records, until_us, index.begin_us, with_ticks=False)
        after_playing = states_after(played_records, until_us, index.begin_us, with_ticks=True)
        assert after_seeking == after_playing
        # after seeking, playing continues with the next record
        following_records = list(seek_state.following)
        batch = Batch([], seek_state.after, at_end=seek_state.at_end, bytes_skipped=0)
        while not batch.at_end:
            batch = read_batch(file, batch.after)
            following_records += batch.records
        assert following_records == records[len(played_records) :]
        return after_seeking, len(played_records), len(seek_state.records)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 1000), fraction=st.floats(0, 1))
def test_seeking_equals_playing_in_generated_flights(tmp_path, seed, fraction):
    path = tmp_path / "made.tlog"
    path.write_bytes(log_bytes(flight(seed, seconds=30)))
    compare_seeking_with_playing(path, fraction)


@pytest.mark.parametrize(
    "fraction", [0.31, 1.0, *(pytest.param(value, marks=pytest.mark.broad) for value in (0.0, 0.77))]
)
def test_seeking_equals_playing_in_a_long_flight_with_checkpoints(tmp_path, fraction):
    path = tmp_path / "long.tlog"
    path.write_bytes(log_bytes(flight(3, seconds=500)))
    vehicles, played_count, fed_count = compare_seeking_with_playing(path, fraction)
    assert fraction == 0.0 or set(vehicles) == {"1", "7"}
    assert fed_count <= 1000, f"{fed_count} of {played_count} frames were needed"


@pytest.mark.parametrize(
    "name",
    ["flight-takeoff-reposition-orbit-gimbal-rtl.tlog.gz", "failsafe-battery.tlog", "offboard-api.tlog.gz"],
)
@pytest.mark.parametrize("fraction", [0.2, pytest.param(0.5, marks=pytest.mark.broad), 0.9])
def test_seeking_equals_playing_in_flights_of_a_real_px4(reference_data, name, fraction):
    vehicles, played_count, fed_count = compare_seeking_with_playing(
        reference_data / "px4" / "tlogs" / name, fraction
    )
    assert len(vehicles) == 1
    assert played_count > 10 * fed_count
    ((identity, flight_state, _, topics, events),) = vehicles.values()
    assert identity.replayed
    assert flight_state.custom_mode
    assert topics["gimbal"] is not None
    assert events


def test_condensed_records_give_the_same_state(tmp_path):
    path = tmp_path / "made.tlog"
    path.write_bytes(log_bytes(flight(9, seconds=20)))
    with open_log(path) as file:
        records = all_records(file)
    condensed = []
    for i in range(0, len(records), 400):
        condensed += condense(records[i : i + 400])
    assert len(condensed) < len(records) / 3
    end_us = records[-1].time_us
    state = states_after(records, end_us, records[0].time_us, with_ticks=False)
    assert states_after(condensed, end_us, records[0].time_us, with_ticks=False) == state


def test_the_index_has_the_acknowledgements_of_mode_commands():
    assert MODE_COMMANDS == mode_cause.MODE_COMMANDS
