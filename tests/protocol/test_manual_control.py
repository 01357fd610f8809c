"""Flying by stick over the WebSocket with the simulated vehicle: what ends and interrupts it, who may, and
that nothing is sent afterwards."""

import asyncio
import itertools
import json
import random
import struct
from contextlib import suppress
from types import SimpleNamespace

import pytest

from gcs_server.api.command_routes import mode as set_mode
from gcs_server.api.control_models import TakeControl
from gcs_server.api.control_routes import take
from gcs_server.api.hold_routes import HoldRequest, hold_several
from gcs_server.api.manual_control_routes import FLOOD_PER_S, StickSocket, show
from gcs_server.api.models import ModeRequest
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import FrameParser, full_payload
from gcs_server.vehicle.services.manual_control import VALID_S, ManualControlService
from tests.protocol.api_calls import ANNA, BOB, journal_entries, json_of, new_station
from tests.protocol.offboard_testbed import sleep
from tests.protocol.simulated_testbed import SimulatedTestbed, until
from tests.unit.vehicle_sim.prepared_stations import station_in_hover
from tests.unit.vehicle_sim.sim_station import Station

CENTRE = {"type": "sticks", "pitch": 0, "roll": 0, "throttle": 500, "yaw": 0}
FORWARD = {**CENTRE, "pitch": 600}
NEUTRAL = (0, 0, 500, 0)


class Closed(Exception):
    pass


class Pad:
    """A client's end of the socket, and the gamepad: `sticks` are sent 25 times a second; None: no frames."""

    def __init__(self):
        self.inbox = asyncio.Queue()
        self.received = []
        self.closed = None
        self.sticks = None

    def submit(self, message):
        self.inbox.put_nowait(message if message is None or isinstance(message, str) else json.dumps(message))

    async def receive_text(self):
        text = await self.inbox.get()
        if text is None:
            raise Closed
        return text

    async def send_text(self, data):
        self.received.append(json.loads(data))

    async def close(self, code=1000, reason=None):
        self.closed = (code, reason)

    async def poll(self):
        while True:
            if self.sticks is not None:
                self.submit(self.sticks)
            await sleep(0.04)

    @property
    def phase(self):
        return next((r["phase"] for r in reversed(self.received) if "phase" in r), None)


def run_by_stick(run_simulated, scenario, *, parameters=None, begin=True):
    """Runs a scenario with a vehicle that hovers in Hold, 10 m above home, and anna's gamepad."""

    async def run():
        station_of_sim = station_in_hover(Station, 10.0, parameters, links=(("gcs", "gcs"),))
        testbed = SimulatedTestbed(sim=station_of_sim.sim)
        sent = []
        feed = testbed._feed_function(0)

        parser = FrameParser()

        def spy(data, peer):
            for frame in parser.feed(data, 0.0):
                if frame.msg_id == d.MAVLINK_MSG_ID_MANUAL_CONTROL:
                    sent.append((testbed.clock.monotonic_s(), struct.unpack_from("<4h", full_payload(frame))))
            feed(data, peer)

        testbed._links[0]._outgoing = spy
        tasks = []
        try:
            vehicle = await testbed.wait_for_vehicle()
            await sleep(1.5)
            server = new_station(testbed)
            server.authority.start()
            pad = Pad()
            rig = SimpleNamespace(testbed=testbed, vehicle=vehicle, server=server, pad=pad, sent=sent)
            rig.serve = lambda who=ANNA, on=pad: tasks.append(
                asyncio.ensure_future(StickSocket(server, who, vehicle.id, on).serve())
            )
            tasks.append(asyncio.ensure_future(pad.poll()))
            if begin:
                rig.serve()
                pad.sticks = CENTRE
                await until(lambda: pad.phase == "flying", 3)
            await scenario(rig)
        finally:
            for task in tasks:
                task.cancel()
            with suppress(asyncio.CancelledError, ExceptionGroup):
                await asyncio.gather(*tasks, return_exceptions=True)
            await testbed.close()

    run_simulated(run)


def mode(rig):
    return rig.vehicle.status.mode


async def select(rig, name, who=ANNA):
    body = ModeRequest(mode=name)
    return json_of(await set_mode(rig.vehicle.id, body, rig.server, who))


async def silence(rig, for_s=2.0):
    """Number of stick messages that are sent in the next seconds."""
    count = len(rig.sent)
    await sleep(for_s)
    return len(rig.sent) - count


def test_the_sticks_fly_the_vehicle_in_position_and_centred_sticks_stop_it(run_simulated):
    async def scenario(rig):
        await select(rig, "position")
        assert rig.pad.phase == "flying"  # a mode that is flown by sticks does not interrupt them
        rig.pad.sticks = FORWARD
        await sleep(3)
        assert rig.sent[-1][1] == (600, 0, 500, 0)
        local = rig.vehicle.topic("local_position").value
        assert max(map(abs, local.velocity_ned_m_s)) > 1.5
        rig.pad.sticks = CENTRE
        await sleep(4)
        assert max(map(abs, rig.vehicle.topic("local_position").value.velocity_ned_m_s)) < 0.3
        times_s = [at_s for at_s, _ in rig.sent[-50:]]
        assert max(b - a for a, b in itertools.pairwise(times_s)) < 0.1

    run_by_stick(run_simulated, scenario)


@pytest.mark.parametrize("name", ["altitude", "stabilized"])
def test_altitude_and_stabilized_are_flown_and_keep_their_height_with_centred_sticks(run_simulated, name):
    async def scenario(rig):
        await select(rig, name)
        rig.pad.sticks = {**CENTRE, "roll": 700}
        await sleep(2)
        assert abs(rig.vehicle.topic("attitude").value.roll_rad) > 0.1
        rig.pad.sticks = CENTRE
        await sleep(2)
        assert mode(rig) == name
        assert abs(rig.vehicle.topic("attitude").value.roll_rad) < 0.05
        assert -rig.vehicle.topic("local_position").value.position_ned_m[2] > 7

    run_by_stick(run_simulated, scenario)


def test_until_the_sticks_were_centred_once_they_are_neutral(run_simulated):
    async def scenario(rig):
        rig.serve()
        rig.pad.sticks = {**FORWARD, "throttle": 0}
        await sleep(1)
        assert (rig.pad.phase, {values for _, values in rig.sent}) == ("centre", {NEUTRAL})
        rig.pad.sticks = CENTRE
        await sleep(0.2)
        rig.pad.sticks = FORWARD
        await sleep(0.2)
        assert (rig.pad.phase, rig.sent[-1][1]) == ("flying", (600, 0, 500, 0))
        rig.pad.sticks = {"type": "neutral"}
        await sleep(0.2)
        assert (rig.pad.phase, rig.sent[-1][1]) == ("centre", NEUTRAL)
        rig.pad.sticks = FORWARD
        await sleep(0.2)
        assert rig.sent[-1][1] == NEUTRAL

    run_by_stick(run_simulated, scenario, begin=False)


def test_without_frames_sending_stops_at_once_the_stream_ends_in_half_a_second_and_the_vehicle_returns(
    run_simulated,
):
    async def scenario(rig):
        await select(rig, "position")
        rig.pad.sticks = FORWARD
        await sleep(1)
        rig.pad.sticks = None
        await sleep(0.06)
        last = len(rig.sent)
        await until(lambda: rig.pad.closed, VALID_S + 0.2)
        assert rig.pad.received[-1] == {"phase": "off", "reason": f"No stick positions for {VALID_S:g} s."}
        rig.pad.sticks = FORWARD  # the tab is awake again
        assert await silence(rig) == 0
        assert len(rig.sent) == last
        await until(lambda: mode(rig) == "rtl", 8)  # COM_FAIL_ACT_T, then NAV_RCL_ACT
        assert journal_entries(rig.server)[-1] == ("anna", "manual_control", "1", "ok")

    run_by_stick(run_simulated, scenario)


def test_hold_of_another_client_makes_the_sticks_neutral_until_their_pilot_goes_on(run_simulated):
    async def scenario(rig):
        await select(rig, "position")
        rig.pad.sticks = FORWARD
        await sleep(1)
        await hold_several(HoldRequest(vehicles=("1",)), rig.server, BOB)
        at = len(rig.sent)
        rig.pad.sticks = {**FORWARD, "pitch": -900}  # a movement by which PX4 would leave Hold
        await sleep(0.5)
        rig.pad.sticks = FORWARD
        await sleep(2)
        assert (mode(rig), rig.pad.phase) == ("hold", "interrupted")
        assert {values for _, values in rig.sent[at + 1 :]} == {NEUTRAL}
        assert any("neutral" in event.text for event in rig.vehicle.events.since())
        rig.pad.submit({"type": "resume"})
        await sleep(0.3)
        assert (mode(rig), rig.pad.phase, rig.sent[-1][1]) == ("hold", "centre", NEUTRAL)
        rig.pad.sticks = CENTRE
        await sleep(0.2)
        rig.pad.sticks = FORWARD
        await until(lambda: mode(rig) == "position", 3)  # PX4's own takeover by a moved stick
        cause = rig.vehicle.mode_cause
        assert (cause.source, cause.who, cause.text) == ("pilot", "anna", "the sticks of anna")

    run_by_stick(run_simulated, scenario)


def test_who_loses_control_sends_nothing_afterwards(run_simulated):
    async def scenario(rig):
        rig.pad.sticks = FORWARD
        await sleep(0.5)
        await take(rig.vehicle.id, rig.server, BOB, TakeControl(force=True))
        at = len(rig.sent)
        await sleep(1)
        assert len(rig.sent) == at
        assert rig.pad.received[-1]["reason"] == "bob has control of the vehicle now."
        assert rig.pad.closed

    run_by_stick(run_simulated, scenario)


def test_a_client_without_control_or_beside_another_pilot_is_refused_and_sends_nothing(run_simulated):
    async def scenario(rig):
        other = Pad()
        rig.serve(BOB, other)
        await sleep(0.5)
        assert other.received[-1]["error"]["code"] == "not_in_control"
        assert other.closed
        second_tab = Pad()
        rig.serve(ANNA, second_tab)
        await sleep(0.5)
        assert "already flies vehicle 1 by stick" in second_tab.received[-1]["error"]["detail"]
        assert rig.pad.phase == "flying"
        assert rig.vehicle.service(ManualControlService).status().by == "anna"

    run_by_stick(run_simulated, scenario)


@pytest.mark.parametrize("value", [0, 4])
def test_a_vehicle_that_ignores_the_sticks_says_so_before_with_its_parameter(run_simulated, value):
    async def scenario(rig):
        rig.serve()
        await sleep(0.5)
        error = rig.pad.received[-1]["error"]
        assert error["code"] == "refused"
        assert f"COM_RC_IN_MODE is {value}" in error["detail"]
        assert "COM_RC_IN_MODE to 1" in error["remedy"]
        view = json_of(await show(rig.vehicle))
        assert f"COM_RC_IN_MODE is {value}" in view["rules"]["problem"]
        assert not rig.sent

    run_by_stick(run_simulated, scenario, parameters={"COM_RC_IN_MODE": value}, begin=False)


@pytest.mark.parametrize(
    ("parameters", "text", "also_in_hold"),
    [
        ({}, "after 0.5 s the vehicle returns to launch and lands there (NAV_RCL_ACT 2).", True),
        ({"COM_RCL_EXCEPT": 2}, "In Hold it stays there (COM_RCL_EXCEPT).", False),
        ({"NAV_RCL_ACT": 1}, "holds its position in Hold mode (NAV_RCL_ACT 1).", True),
    ],
)
def test_what_the_vehicle_does_without_sticks_is_said_before(run_simulated, parameters, text, also_in_hold):
    async def scenario(rig):
        view = json_of(await show(rig.vehicle))
        assert text in view["rules"]["loss"]["text"]
        assert (view["phase"], view["rules"]["problem"]) == ("off", None)
        assert view["rules"]["loss"]["also_in_hold"] is also_in_hold

    run_by_stick(run_simulated, scenario, parameters=parameters, begin=False)


@pytest.mark.parametrize(
    ("message", "text"),
    [
        ({**CENTRE, "pitch": 1001}, "pitch: "),
        ({**CENTRE, "throttle": -1}, "throttle: "),
        ('{"type": "sticks", "pitch": NaN, "roll": 0, "throttle": 500, "yaw": 0}', ""),
        ('{"type": "sticks", "pitch": 1e999, "roll": 0, "throttle": 500, "yaw": 0}', ""),
        ({**CENTRE, "yaw": True}, "yaw: "),
        ({**CENTRE, "flaps": 1}, "flaps: "),
        ({"type": "sticks"}, "pitch: "),
        ({"type": "warp"}, "warp"),
        ("[" * 400, "not read"),
        ("x" * 2000, "1000 characters"),
    ],
)
def test_a_wrong_message_is_answered_with_its_field_and_is_no_frame(run_simulated, message, text):
    async def scenario(rig):
        rig.pad.sticks = None
        await sleep(0.05)
        at = len(rig.sent)
        for _ in range(20):
            rig.pad.submit(message)
            await sleep(0.04)
        errors = [r["error"] for r in rig.pad.received if "error" in r]
        assert errors[0]["code"] == "invalid_request"
        assert text in errors[0]["detail"]
        assert len(rig.sent) == at
        assert rig.pad.closed, "garbage kept the stream alive"

    run_by_stick(run_simulated, scenario)


def test_its_pilots_end_sends_neutral_sticks_once_and_a_flood_ends_the_stream(run_simulated):
    async def scenario(rig):
        rig.pad.sticks = FORWARD
        await sleep(0.5)
        rig.pad.sticks = None
        rig.pad.submit({"type": "end"})
        await sleep(0.1)
        assert rig.sent[-1][1] == NEUTRAL
        assert rig.pad.closed == (1000, "ended")
        flood = Pad()
        rig.serve(ANNA, flood)
        for _ in range(FLOOD_PER_S + 10):
            flood.submit(CENTRE)
        await sleep(0.3)
        assert "messages in a second" in flood.received[-1]["reason"]
        assert await silence(rig) == 0

    run_by_stick(run_simulated, scenario)


@pytest.mark.parametrize(
    "seed", [1, 2, *(pytest.param(seed, marks=pytest.mark.broad) for seed in range(3, 12))]
)
def test_after_any_order_of_ends_and_interruptions_no_deflected_stick_is_sent(run_simulated, seed):
    """Each step happens between frames at a random time; afterwards the sticks are neutral or silent."""

    async def scenario(rig):
        random_ = random.Random(seed)
        await select(rig, "position")
        for _ in range(6):
            rig.pad.sticks = FORWARD
            await sleep(random_.uniform(0.0, 0.3))
            step = random_.choice(["hold", "taken", "hands off", "silent", "closed"])
            if step == "hold":
                await hold_several(HoldRequest(vehicles=("1",)), rig.server, BOB)
            elif step == "taken":
                await take(rig.vehicle.id, rig.server, BOB, TakeControl(force=True))
            elif step == "hands off":
                rig.pad.sticks = {"type": "neutral"}
                await sleep(0.05)
            elif step == "silent":
                rig.pad.sticks = None
                await sleep(0.1)
            else:
                rig.pad.submit(None)
                await sleep(0.01)
            at = len(rig.sent)
            await sleep(random_.uniform(0.6, 1.0))
            assert {values for _, values in rig.sent[at:]} <= {NEUTRAL}, step
            await take(rig.vehicle.id, rig.server, ANNA, TakeControl(force=True))
            if rig.pad.closed or step == "closed":
                rig.pad.sticks, rig.pad.closed, rig.pad.received = None, None, []
                rig.pad.inbox = asyncio.Queue()
                rig.serve()
            else:
                rig.pad.submit({"type": "resume"})
            rig.pad.sticks = CENTRE
            await until(lambda: rig.pad.phase == "flying", 3)

    run_by_stick(run_simulated, scenario)
