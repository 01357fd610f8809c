"""Start and stop of a setpoint stream with a fake vehicle, on simulated time."""

import asyncio
import logging
from types import SimpleNamespace

import pytest

from gcs_server.clock import LoopClock
from gcs_server.errors import NoReply, Refused, Rejected
from gcs_server.faults import Isolation
from gcs_server.scenarios.in_loop_scheduler import InLoopScheduler
from gcs_server.scenarios.simulated_time import run_on_simulated_time
from gcs_server.streamer.offboard import streamer as streamer_module
from gcs_server.streamer.offboard.streamer import Streamer
from gcs_server.streamer.values.stream_request import StreamRequest
from gcs_server.supervise import Supervisor
from gcs_server.vehicle.autopilot import autopilot_of
from gcs_server.vehicle.events import EventFeed
from gcs_server.vehicle.reach import reach_of
from gcs_server.vehicle.samples import Attitude, LocalPosition, Sample
from gcs_server.vehicle.services.command import ModeCommand
from gcs_server.vehicle.tickets import Tickets
from missions.floor import Floor
from missions.setpoints import Position

POSITION = Position(position_ned_m=(0.0, 0.0, -5.0), yaw_ned_rad=0.0)
PARAMS = {"COM_OF_LOSS_T": 1.0, "COM_OBL_RC_ACT": 0}


class Vehicle:
    """A fake vehicle, which is also its own command and parameter service.

    `mode_requests` has each requested mode and the number of setpoints sent before the request.
    """

    def __init__(self, clock):
        self.id = "1"
        self.identity = SimpleNamespace(
            system_id=1, component_id=1, replayed=False, firmware=None, software=autopilot_of(12)
        )
        self.status = SimpleNamespace(mode="hold", armed=True, link_lost=False)
        self.events = EventFeed("1")
        self.isolation = Isolation(clock, logging.getLogger("test"), "Vehicle 1")
        connection = SimpleNamespace(protocol="MAVLink")
        self.endpoints = (SimpleNamespace(connection=connection, received_s=0.0, over_ros2=False),)
        self.reach = reach_of(self.endpoints)
        self.clock = clock
        self.command = self.params = self
        self.offboard = None
        self.has_position = True
        self.in_failsafe = False
        self.tickets = Tickets()
        self.floor = SimpleNamespace(now=Floor)
        self.mode_error = None
        self.latest_command = None
        self.mode_request_hangs = False
        self.sent_ids = []
        self.mode_requests = []

    def require_commandable(self, *, on_lost_link=False):
        pass

    def require_no_kill(self, what):
        pass

    async def wait_for_kill(self):
        pass

    async def set_mode(self, name, *, ticket=None):
        self.mode_requests.append((name, len(self.sent_ids)))
        if self.mode_request_hangs:
            await asyncio.sleep(30)
        if self.mode_error:
            raise self.mode_error
        self.status.mode = name

    def recent_command(self, mode):
        return (
            self.latest_command
            if self.latest_command is not None and self.latest_command.mode == mode
            else None
        )

    def known_each(self, names):
        return tuple(None for _ in names)

    async def get(self, name):
        if name not in PARAMS:
            raise NoReply(f"{name} is not known", deadline_s=0)
        return SimpleNamespace(value=PARAMS[name])

    def topic(self, name):
        now_s = self.clock.monotonic_s()
        values = {"attitude": Attitude(0, 0, 0.5, (1, 0, 0, 0), (0, 0, 0))}
        if self.has_position:
            values["local_position"] = LocalPosition((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        return Sample(name, None, 0.0, now_s, values[name]) if name in values else None

    def send_payload(self, msg_id, payload):
        self.sent_ids.append(msg_id)
        return True


def make_streamer(clock, stalls=()):
    """Supervisor and streamer; the scheduler runs in the event loop, except in `stalls` (from, to) [s]."""
    supervisor, streams = Supervisor(clock), InLoopScheduler(clock)
    began_s = clock.monotonic_s()

    async def run():
        while True:
            elapsed_s = clock.monotonic_s() - began_s
            if not any(from_s <= elapsed_s < to_s for from_s, to_s in stalls):
                streams.step()
            await clock.sleep(0.004)

    supervisor.start("streams", run)
    return supervisor, Streamer(clock, streams)


def run_test(scenario, stalls=()):
    async def run():
        clock = LoopClock(asyncio.get_running_loop())
        vehicle = Vehicle(clock)
        supervisor, streamer = make_streamer(clock, stalls)
        streamer.attach(vehicle)
        streamer.start(supervisor)
        try:
            await scenario(vehicle)
        finally:
            streamer.close()
            await supervisor.close()

    run_on_simulated_time(run)


def test_setpoints_are_streamed_before_offboard_is_requested_and_the_failsafe_is_reported():
    async def scenario(vehicle):
        status = await vehicle.offboard.start(StreamRequest(POSITION, 60.0, client="me"))
        ((mode, sent_before_request),) = vehicle.mode_requests
        assert mode == "offboard"
        assert sent_before_request == pytest.approx(60, abs=2)  # 1.2 s at 50 Hz
        assert (status.state, status.client) == ("streaming", "me")
        assert "lands at its current position" in status.if_stream_stops
        with pytest.raises(Refused, match="already"):
            await vehicle.offboard.start(StreamRequest(POSITION, 60.0))
        await vehicle.offboard.stop()
        sent_count = len(vehicle.sent_ids)
        await asyncio.sleep(0.1)
        assert len(vehicle.sent_ids) == sent_count
        assert vehicle.status.mode == "hold"

    run_test(scenario)


def test_unsent_setpoints_do_not_count_as_streamed():
    """If the machine stalls during the start, the server must not request Offboard after a single
    setpoint."""

    async def scenario(vehicle):
        await vehicle.offboard.start(StreamRequest(POSITION, 60.0))
        assert vehicle.mode_requests[0][1] >= 60

    run_test(scenario, stalls=[(0.01, 1.3)])


def test_offboard_is_not_requested_without_a_steady_stream():
    async def scenario(vehicle):
        with pytest.raises(Refused, match="too busy"):
            await vehicle.offboard.start(StreamRequest(POSITION, 60.0))
        assert vehicle.mode_requests == []
        assert not vehicle.offboard.status().streaming

    run_test(scenario, stalls=[(n + 0.1, n + 1.0) for n in range(10)])  # runs for 0.1 s of each second


def test_a_refused_mode_request_stops_the_stream_and_raises_the_error():
    async def scenario(vehicle):
        vehicle.mode_error = Rejected("Offboard is not available", reasons=("no",))
        with pytest.raises(Rejected, match="not available"):
            await vehicle.offboard.start(StreamRequest(POSITION, 60.0))
        assert not vehicle.offboard.status().streaming
        with pytest.raises(Refused, match="no setpoint stream"):
            await vehicle.offboard.setpoint(StreamRequest(POSITION, 60.0))

    run_test(scenario)


@pytest.mark.parametrize("protocol", ["ROS 2", "MAVLink"])
def test_over_ros_2_an_unanswered_or_refused_offboard_request_is_sent_again(protocol):
    """PX4's side of DDS may connect later than this one."""

    async def scenario(vehicle):
        link = SimpleNamespace(unusable_topics=lambda _peer: {})
        connection = SimpleNamespace(protocol=protocol, link=link)
        vehicle.endpoints = (SimpleNamespace(connection=connection, peer=None, received_s=0.0),)
        errors = [NoReply("no answer", deadline_s=1.0)]
        set_mode = vehicle.set_mode

        async def set_mode_late(name, *, ticket=None):
            vehicle.mode_error = errors.pop() if errors else None
            await set_mode(name)

        vehicle.set_mode = set_mode_late
        if protocol == "MAVLink":
            with pytest.raises(NoReply):
                await vehicle.offboard.start(StreamRequest(POSITION, 60.0))
            return
        await vehicle.offboard.start(StreamRequest(POSITION, 60.0))
        assert [mode for mode, _ in vehicle.mode_requests] == ["offboard", "offboard"]
        assert vehicle.mode_requests[1][1] - vehicle.mode_requests[0][1] >= 60
        await vehicle.offboard.stop()
        errors[:] = [Rejected("no position", reasons=())] * 2
        with pytest.raises(Rejected):
            await vehicle.offboard.start(StreamRequest(POSITION, 60.0))

    run_test(scenario)


def test_the_refusal_of_a_start_names_the_reason():
    async def scenario(vehicle):
        vehicle.has_position = False
        with pytest.raises(Refused, match="estimate"):
            await vehicle.offboard.start(StreamRequest(POSITION))
        vehicle.has_position = True
        with pytest.raises(Refused, match="2000 m"):
            await vehicle.offboard.start(StreamRequest(Position(position_ned_m=(2000.0, 0.0, 0.0))))
        vehicle.status.mode = "offboard"
        with pytest.raises(Refused, match="another program"):
            await vehicle.offboard.start(StreamRequest(POSITION))
        assert vehicle.sent_ids == []

    run_test(scenario)


def test_leaving_offboard_ends_the_stream_with_an_event():
    async def scenario(vehicle):
        await vehicle.offboard.start(StreamRequest(POSITION, 60.0))
        vehicle.status.mode = "position"
        await asyncio.sleep(0.35)
        assert not vehicle.offboard.status().streaming
        assert [e.data["code"] for e in vehicle.events.since()] == ["left_offboard"]

    run_test(scenario)


def test_a_mode_commanded_by_a_client_ends_the_stream_without_a_warning():
    async def scenario(vehicle):
        await vehicle.offboard.start(StreamRequest(POSITION, 60.0))
        vehicle.latest_command = ModeCommand("Land", "land", "page", 0.0)
        vehicle.status.mode = "land"
        await asyncio.sleep(0.35)
        (event,) = vehicle.events.since()
        assert (event.kind, event.severity, event.data["code"]) == ("command", 6, "commanded")
        assert "page commanded 'Land'" in event.text
        assert "page" in vehicle.offboard.status().ended

    run_test(scenario)


def test_shutdown_stops_all_streams_at_the_same_time_within_the_deadline(monkeypatch):
    monkeypatch.setattr(streamer_module, "STOP_ALL_S", 0.4)

    async def run():
        clock = LoopClock(asyncio.get_running_loop())
        supervisor, streamer = make_streamer(clock)
        vehicles = [Vehicle(clock) for _ in range(3)]
        for number, vehicle in enumerate(vehicles, 1):
            vehicle.id = str(number)
            streamer.attach(vehicle)
        streamer.start(supervisor)
        try:
            await asyncio.gather(*(v.offboard.start(StreamRequest(POSITION, 60.0)) for v in vehicles))
            vehicles[1].mode_request_hangs = vehicles[2].mode_request_hangs = True
            began_s = clock.monotonic_s()
            results = {s.vehicle: s for s in await streamer.stop_all()}
            assert clock.monotonic_s() - began_s < 0.5
            assert results["1"].error is None
            assert [type(results[v].error) for v in ("2", "3")] == [NoReply, NoReply]
            assert [v.status.mode for v in vehicles] == ["hold", "offboard", "offboard"]
            assert [e.severity for e in vehicles[1].events.since()] == [4]
        finally:
            streamer.close()
            await supervisor.close()

    run_on_simulated_time(run)
