"""Starting and stopping the stream against a vehicle made of plain objects, with the real thread."""

import asyncio
import time
from types import SimpleNamespace

import pytest

from gcs_server.clock import SystemClock
from gcs_server.errors import NoReply, Refused, Rejected
from gcs_server.streamer import offboard
from gcs_server.streamer import offboard_control as module
from gcs_server.streamer.offboard import Streamer
from gcs_server.streamer.rounds import Rounds
from gcs_server.streamer.setpoints import Order, Position
from gcs_server.supervise import Supervisor
from gcs_server.vehicle.events import EventFeed
from gcs_server.vehicle.samples import Attitude, LocalPosition, Sample
from gcs_server.vehicle.services.command import Asked

UP = Position(position_ned_m=(0.0, 0.0, -5.0), yaw_ned_rad=0.0)
PARAMS = {"COM_OF_LOSS_T": 1.0, "COM_OBL_RC_ACT": 0}


class Vehicle:
    def __init__(self):
        self.id = "1"
        self.identity = SimpleNamespace(system_id=1, component_id=1)
        self.status = SimpleNamespace(mode="hold", armed=True, link_lost=False)
        self.events = EventFeed("1")
        self.endpoints = (SimpleNamespace(connection=SimpleNamespace(protocol="MAVLink")),)
        self.clock = SystemClock()
        self.command = self.params = self
        self.offboard = None
        self.located = True
        self.refuses = None
        self.ours = None
        self.hangs = False
        self.sent = []
        self.asked = []

    def require_commandable(self):
        pass

    async def set_mode(self, name):
        self.asked.append((name, len(self.sent)))
        if self.hangs:
            await asyncio.sleep(30)
        if self.refuses:
            raise self.refuses
        self.status.mode = name

    def asked_for(self, mode):
        return self.ours if self.ours is not None and self.ours.mode == mode else None

    def known(self, name):
        return None

    async def get(self, name):
        if name not in PARAMS:
            raise NoReply(f"{name} is not known", deadline_s=0)
        return SimpleNamespace(value=PARAMS[name])

    def topic(self, name):
        now_s = time.monotonic()
        values = {"attitude": Attitude(0, 0, 0.5, (1, 0, 0, 0), (0, 0, 0))}
        if self.located:
            values["local_position"] = LocalPosition((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        return Sample(name, None, 0.0, now_s, values[name]) if name in values else None

    def send_payload(self, msg_id, payload):
        self.sent.append(msg_id)
        return True


@pytest.fixture(autouse=True)
def _short(monkeypatch):
    monkeypatch.setattr(module, "PRE_STREAM_S", 0.2)


def streaming(clock):
    """A streamer whose rounds the loop runs."""
    supervisor, rounds = Supervisor(clock), Rounds(clock)

    async def run():
        while True:
            rounds.step()
            await clock.sleep(0.004)

    supervisor.start("rounds", run)
    return supervisor, Streamer(clock, rounds)


def told(story):
    async def run():
        clock, vehicle = SystemClock(), Vehicle()
        supervisor, streamer = streaming(clock)
        streamer.attach(vehicle)
        streamer.start(supervisor)
        try:
            await story(vehicle)
        finally:
            streamer.close()
            await supervisor.close()

    asyncio.run(run())


def test_streams_before_it_asks_for_offboard_and_says_what_a_lost_stream_means():
    async def story(vehicle):
        status = await vehicle.offboard.start(Order(UP, 60.0, client="me"))
        assert vehicle.asked == [("offboard", vehicle.asked[0][1])]
        assert vehicle.asked[0][1] >= 8
        assert (status.state, status.client) == ("streaming", "me")
        assert "lands where it is" in status.if_stream_stops
        with pytest.raises(Refused, match="already"):
            await vehicle.offboard.start(Order(UP, 60.0))
        await vehicle.offboard.stop()
        count = len(vehicle.sent)
        await asyncio.sleep(0.1)
        assert len(vehicle.sent) == count
        assert vehicle.status.mode == "hold"

    told(story)


def test_a_refusal_stops_the_stream_and_is_passed_on():
    async def story(vehicle):
        vehicle.refuses = Rejected("Offboard is not available", reasons=("no",))
        with pytest.raises(Rejected, match="not available"):
            await vehicle.offboard.start(Order(UP, 60.0))
        assert not vehicle.offboard.status().streaming
        with pytest.raises(Refused, match="no setpoint stream"):
            vehicle.offboard.setpoint(Order(UP, 60.0))

    told(story)


def test_prerequisites_are_explained():
    async def story(vehicle):
        vehicle.located = False
        with pytest.raises(Refused, match="estimate"):
            await vehicle.offboard.start(Order(UP))
        vehicle.located = True
        with pytest.raises(Refused, match="2000 m"):
            await vehicle.offboard.start(Order(Position(position_ned_m=(2000.0, 0.0, 0.0))))
        vehicle.status.mode = "offboard"
        with pytest.raises(Refused, match="somebody else"):
            await vehicle.offboard.start(Order(UP))
        assert vehicle.sent == []

    told(story)


def test_leaving_offboard_ends_the_stream_and_is_told():
    async def story(vehicle):
        await vehicle.offboard.start(Order(UP, 60.0))
        vehicle.status.mode = "position"
        await asyncio.sleep(0.35)
        assert not vehicle.offboard.status().streaming
        assert [e.data["code"] for e in vehicle.events.since()] == ["left_offboard"]

    told(story)


def test_a_mode_that_we_commanded_ends_the_stream_as_news_not_as_a_warning():
    async def story(vehicle):
        await vehicle.offboard.start(Order(UP, 60.0))
        vehicle.ours = Asked("Land", "land", "page", 0.0)
        vehicle.status.mode = "land"
        await asyncio.sleep(0.35)
        (told,) = vehicle.events.since()
        assert (told.kind, told.severity, told.data["code"]) == ("command", 6, "commanded")
        assert "page commanded 'Land'" in told.text
        assert "page" in vehicle.offboard.status().ended

    told(story)


def test_at_the_servers_end_all_are_stopped_at_once_and_one_that_hangs_costs_no_more_than_the_deadline(
    monkeypatch,
):
    monkeypatch.setattr(offboard, "STOP_ALL_S", 0.4)

    async def run():
        clock = SystemClock()
        supervisor, streamer = streaming(clock)
        fleet = [Vehicle() for _ in range(3)]
        for number, vehicle in enumerate(fleet, 1):
            vehicle.id = str(number)
            streamer.attach(vehicle)
        streamer.start(supervisor)
        try:
            await asyncio.gather(*(v.offboard.start(Order(UP, 60.0)) for v in fleet))
            fleet[1].hangs = fleet[2].hangs = True
            began_s = time.monotonic()
            done = {s.vehicle: s for s in await streamer.stop_all()}
            assert time.monotonic() - began_s < 0.7
            assert done["1"].error is None
            assert [type(done[v].error) for v in "23"] == [NoReply, NoReply]
            assert [v.status.mode for v in fleet] == ["hold", "offboard", "offboard"]
            assert [e.severity for e in fleet[1].events.since()] == [4]
        finally:
            streamer.close()
            await supervisor.close()

    asyncio.run(run())
