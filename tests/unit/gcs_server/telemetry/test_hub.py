"""The telemetry hub with a fake fleet: newest values, no backlog, events, invalid requests."""

import asyncio
import json
import logging
import math
from types import SimpleNamespace

import pytest

from gcs_server.clock import LoopClock, SystemClock
from gcs_server.faults import Isolation
from gcs_server.scenarios.simulated_time import run_on_simulated_time
from gcs_server.telemetry.hub import CLOSE_TOO_SLOW, EVENT_QUEUE_CHARACTERS, EVENT_QUEUE_LENGTH, Hub
from gcs_server.vehicle.events import Event
from gcs_server.vehicle.samples import Estimator, Hud, Sample

LONE_SURROGATE = "\ud800"
"""A character that cannot be encoded as UTF-8."""


class Fleet:
    """A fake fleet of one vehicle; the test sets its samples and publishes its events."""

    def __init__(self):
        self.samples = {}
        self.vehicle = SimpleNamespace(
            id="1",
            topic=self.samples.get,
            topic_received_s=lambda topic: getattr(self.samples.get(topic), "received_monotonic_s", None),
            offboard=None,
            identity={"simulated": True},
            listeners=set(),
            isolation=Isolation(SystemClock(), logging.getLogger("test"), "Vehicle 1"),
        )
        self.callbacks = []

    def all(self):
        return [self.vehicle]

    def subscribe(self, callback):
        self.callbacks.append(callback)
        return lambda: self.callbacks.remove(callback)

    def publish(self, event):
        self.callbacks[0](event)

    def set_climb(self, climb_m_s, at_s):
        self.samples["hud"] = Sample("hud", 1.5, 1e9 + at_s, at_s, Hud(1.0, 1.0, climb_m_s, 50))


class Socket:
    """A client's socket: it sends instantly while `writable` is set, otherwise not at all."""

    def __init__(self):
        self.sent = []
        self.messages = asyncio.Queue()
        self.writable = asyncio.Event()
        self.writable.set()
        self.closed = None

    async def send_text(self, data):
        await self.writable.wait()
        self.sent.append(json.loads(data))

    async def receive_text(self):
        return await self.messages.get()

    async def close(self, code=1000, reason=None):
        self.closed = code

    def samples(self, topic):
        messages = [message for message in self.sent if message["type"] == "samples"]
        return [s for message in messages for s in message["samples"] if s["topic"] == topic]

    def values(self, topic):
        return [sample["value"] for sample in self.samples(topic)]

    def times(self, topic):
        return [sample["received_unix_s"] for sample in self.samples(topic)]

    def climbs(self):
        return [value["climb_m_s"] for value in self.values("hud")]


def event(index):
    return Event(index, "status_text", "1", 1e9, 4, f"text {index}")


def run_test(scenario):
    async def run():
        fleet, socket = Fleet(), Socket()
        hub = Hub(LoopClock(asyncio.get_running_loop()), fleet)
        async with asyncio.timeout(60), asyncio.TaskGroup() as group:
            hub_task = group.create_task(hub.serve(socket))
            await socket.messages.put(json.dumps({"type": "subscribe", "topics": ["hud"], "rate_hz": 100}))
            await scenario(fleet, socket, hub)
            hub_task.cancel()

    run_on_simulated_time(run)


def test_a_slow_client_gets_the_newest_value_and_no_backlog():
    async def scenario(fleet, socket, hub):
        fleet.set_climb(1.0, 1.0)
        await asyncio.sleep(0.05)
        assert socket.climbs() == [1.0], "an unchanged value was sent again"
        socket.writable.clear()
        for n in range(2, 12):
            fleet.set_climb(float(n), float(n))
            await asyncio.sleep(0.012)
        socket.writable.set()
        await asyncio.sleep(0.05)
        assert socket.climbs()[-1] == 11.0
        assert len(socket.climbs()) <= 3

    run_test(scenario)


def test_a_value_that_arrives_after_a_pause_is_sent_at_once_and_the_next_after_a_period():
    async def scenario(fleet, socket, hub):
        def receive(climb_m_s):
            fleet.set_climb(climb_m_s, climb_m_s)
            for listener in tuple(fleet.vehicle.listeners):
                listener()

        await socket.messages.put(json.dumps({"type": "subscribe", "topics": ["hud"], "rate_hz": 1}))
        await asyncio.sleep(2.5)
        receive(1.0)
        await asyncio.sleep(0.001)
        assert socket.climbs() == [1.0]
        receive(2.0)
        await asyncio.sleep(0.9)
        assert socket.climbs() == [1.0]
        await asyncio.sleep(0.2)
        assert socket.climbs() == [1.0, 2.0]

    run_test(scenario)


def test_a_client_that_needs_another_topic_is_woken_once_a_period_and_leaves_nothing_behind():
    async def scenario(fleet, socket, hub):
        scans = []
        fleet.vehicle.topic_received_s = lambda topic: scans.append(topic)
        await socket.messages.put(json.dumps({"type": "subscribe", "topics": ["hud"], "rate_hz": 1}))
        await asyncio.sleep(1.5)
        scans.clear()
        for _ in range(500):
            for listener in tuple(fleet.vehicle.listeners):
                listener()
            await asyncio.sleep(0.01)
        assert len(scans) <= 11
        await asyncio.sleep(2)
        assert len(fleet.vehicle.listeners) == 1
        vehicles.append(fleet.vehicle)

    vehicles = []
    run_test(scenario)
    assert not vehicles[0].listeners


def test_a_topic_of_the_server_is_sent_after_subscribing_and_after_each_change():
    async def scenario(fleet, socket, hub):
        subscription = json.dumps(
            {"type": "subscribe", "topics": ["hud", "identity", "offboard"], "rate_hz": 50}
        )
        stream_status = {"state": "idle"}
        fleet.vehicle.offboard = SimpleNamespace(status=lambda: dict(stream_status))
        await socket.messages.put(subscription)
        await asyncio.sleep(30)
        assert socket.values("offboard") == [{"state": "idle"}], "an unchanged value was repeated"
        stream_status["state"] = "streaming"
        await asyncio.sleep(0.2)
        assert socket.values("offboard")[1:] == [{"state": "streaming"}]
        await socket.messages.put(subscription)
        await asyncio.sleep(0.2)
        assert socket.values("offboard")[2:] == [{"state": "streaming"}], (
            "the new subscription did not get the value"
        )
        assert socket.values("identity") == [{"simulated": True}] * 2
        assert socket.times("offboard") == sorted(socket.times("offboard"))
        assert socket.times("offboard")[1] == socket.times("offboard")[2], (
            "the repeated value does not have the time of the change"
        )

    run_test(scenario)


def test_the_topics_of_a_vehicle_that_is_added_again_are_sent_again():
    async def scenario(fleet, socket, hub):
        await socket.messages.put(json.dumps({"type": "subscribe", "topics": ["identity"], "rate_hz": 50}))
        await asyncio.sleep(5)
        for kind in ("vehicle_removed", "vehicle_added"):
            fleet.publish(Event(1, kind, "1", 1e9, 5, "its link was closed"))
        await asyncio.sleep(0.1)
        kinds = [f["event"]["kind"] if f["type"] == "event" else f["type"] for f in socket.sent]
        assert kinds == ["hello", "samples", "vehicle_removed", "vehicle_added", "samples"]

    run_test(scenario)


def test_a_replaced_vehicle_is_announced_before_its_samples():
    async def scenario(fleet, socket, hub):
        replays = []
        hub.set_replays_source(lambda: replays)
        await socket.messages.put(json.dumps({"type": "subscribe", "topics": ["identity"], "rate_hz": 50}))
        await asyncio.sleep(1)
        socket.writable.clear()
        replays.append({"name": "replay-1"})
        await asyncio.sleep(0.1)
        fleet.publish(Event(1, "vehicle_removed", "1", 1e9, 5, "the replay was moved to another time"))
        socket.writable.set()
        await asyncio.sleep(0.1)
        assert [f["type"] for f in socket.sent] == ["hello", "samples", "replays", "event", "samples"]

    run_test(scenario)


def test_nan_is_sent_as_null():
    async def scenario(fleet, socket, hub):
        fleet.set_climb(math.nan, 1.0)
        await asyncio.sleep(0.05)
        assert socket.climbs() == [None]

    run_test(scenario)


def test_every_event_is_sent_and_too_many_unread_events_disconnect_the_client():
    async def scenario(fleet, socket, hub):
        await asyncio.sleep(0.02)
        for n in range(10):
            fleet.publish(event(n))
        await asyncio.sleep(0.05)
        texts = [f["event"]["text"] for f in socket.sent if f["type"] == "event"]
        assert texts == [f"text {n}" for n in range(10)]
        socket.writable.clear()
        for n in range(EVENT_QUEUE_LENGTH + 5):
            fleet.publish(event(n))
        socket.writable.set()
        await asyncio.sleep(0.05)
        assert socket.closed == CLOSE_TOO_SLOW

    run_test(scenario)


def test_a_topic_that_cannot_be_encoded_does_not_affect_other_topics():
    async def scenario(fleet, socket, hub):
        subscription = {"type": "subscribe", "topics": ["hud", "estimator", "gps"], "rate_hz": 100}
        await socket.messages.put(json.dumps(subscription))
        fleet.samples["estimator"] = Sample("estimator", 1.5, 1e9, 1.0, Estimator(LONE_SURROGATE, 0.0, 0.0))
        fleet.set_climb(1.0, 1.0)
        await asyncio.sleep(0.05)
        fleet.set_climb(2.0, 2.0)
        await asyncio.sleep(0.05)
        assert socket.climbs()[-2:] == [1.0, 2.0], "the other topics were not sent"
        (fault,) = fleet.vehicle.isolation.faults
        assert "estimator" in fault
        fleet.samples["estimator"] = Sample("estimator", 1.5, 1e9, 2.0, Estimator(1, 0.0, 0.0))
        await asyncio.sleep(0.05)
        assert fleet.vehicle.isolation.faults == [], "the fault was still reported"

    run_test(scenario)


def test_an_event_that_cannot_be_encoded_is_not_sent():
    async def scenario(fleet, socket, hub):
        await asyncio.sleep(0.02)
        fleet.publish(Event(1, "status_text", "1", 1e9, 4, "text", {"value": LONE_SURROGATE}))
        fleet.publish(event(2))
        await asyncio.sleep(0.05)
        assert [f["event"]["text"] for f in socket.sent if f["type"] == "event"] == ["text 2"]

    run_test(scenario)


@pytest.mark.parametrize(
    "message", ['{"type": "subscribe", "rate_hz": 0}', "[]", '{"type": "subscribe", "topics": "all"}']
)
def test_an_invalid_request_causes_an_error_message_and_the_socket_stays_open(message):
    async def scenario(fleet, socket, hub):
        await socket.messages.put(message)
        await asyncio.sleep(0.05)
        assert [f for f in socket.sent if f["type"] == "error"]
        assert socket.closed is None

    run_test(scenario)


def test_errors_for_a_client_that_reads_nothing_use_little_memory():
    async def scenario(fleet, socket, hub):
        await asyncio.sleep(0.02)
        socket.writable.clear()
        invalid = json.dumps({"type": "subscribe", "topics": ["x" * 60_000]})
        for _ in range(2000):
            await socket.messages.put(invalid)
        await asyncio.sleep(0.1)
        (client,) = hub._clients
        assert sum(map(len, client._events)) < 10_000
        socket.writable.set()
        await asyncio.sleep(0.1)
        assert socket.closed is None
        await socket.messages.put(invalid)
        await asyncio.sleep(0.05)
        assert socket.sent[-1]["type"] == "error"

    run_test(scenario)


def test_unread_events_are_also_limited_by_their_size():
    async def scenario(fleet, socket, hub):
        await asyncio.sleep(0.02)
        socket.writable.clear()
        for n in range(50):
            fleet.publish(Event(n, "status_text", "1", 1e9, 4, "x" * 100_000))
        (client,) = hub._clients
        assert sum(map(len, client._events)) < EVENT_QUEUE_CHARACTERS + 200_000
        socket.writable.set()
        await asyncio.sleep(0.05)
        assert socket.closed == CLOSE_TOO_SLOW

    run_test(scenario)


@pytest.mark.parametrize(
    "message",
    [
        '{"type": "subscribe", "vehicles": ' + json.dumps([str(n) for n in range(300)]) + "}",
        '{"type": "subscribe", "topics": ' + "[" * 20_000 + "]" * 20_000 + "}",
        '{"type": "subscribe", "topics": ["' + "x" * 70_000 + '"]}',
    ],
)
def test_the_error_about_a_too_long_request_is_short(message):
    async def scenario(fleet, socket, hub):
        await socket.messages.put(message)
        await asyncio.sleep(0.05)
        (error,) = [f for f in socket.sent if f["type"] == "error"]
        assert len(error["detail"]) < 600
        assert socket.closed is None

    run_test(scenario)


def test_ros_2_topics_are_inspected_twice_a_second_and_only_for_a_client_that_names_them():
    async def scenario(fleet, socket, hub):
        inspections = []
        hub.set_ros2_topics_source(
            lambda vehicle: inspections.append(vehicle.id) or {"topics": len(inspections)}
        )
        await socket.messages.put(json.dumps({"type": "subscribe", "rate_hz": 10}))
        await asyncio.sleep(5)
        assert inspections == []
        await socket.messages.put(json.dumps({"type": "subscribe", "topics": ["ros2_topics"], "rate_hz": 10}))
        await asyncio.sleep(5)
        assert 9 <= len(inspections) <= 11, "the topics were not inspected twice a second"
        assert socket.values("ros2_topics")[-1] == {"topics": len(inspections)}

    run_test(scenario)
