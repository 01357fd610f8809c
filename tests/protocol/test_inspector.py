"""The MAVLink inspector with the simulated vehicle: what arrives, at which rate and loss, plotted fields, and
messages that a person writes."""

import asyncio
from types import SimpleNamespace

import pytest

from gcs_server.api import inspector_routes
from gcs_server.control.commands import BY_CALL
from gcs_server.errors import InvalidRequest, Refused
from gcs_server.logbook import live as live_module
from gcs_server.logbook.live import live_values
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import Frame, encode_frame
from gcs_server.mavlink.definitions import IDS, definition, payload_of
from gcs_server.mavlink.tables import LAYOUTS
from gcs_server.vehicle.services import inspector as inspector_module
from gcs_server.vehicle.services import raw_messages
from gcs_server.vehicle.services.inspector import IDLE_S, MessageInspector
from gcs_server.vehicle.services.raw_messages import RawMessages
from tests.protocol.api_calls import ANNA, journal_entries, json_of, run_with_routes
from tests.protocol.memory_testbed import MemoryTestbed
from tests.protocol.simulated_autopilot import SimulatedAutopilot

ROLL = "ATTITUDE:1.1/roll"


def run_with_inspector(run_simulated, scenario, *, loss=0.0):
    async def run():
        testbed = MemoryTestbed()
        autopilot = SimulatedAutopilot(testbed.link())
        try:
            vehicle = await testbed.wait_for_vehicle()
            autopilot.loss = loss
            await scenario(vehicle, vehicle.service(MessageInspector), autopilot)
        finally:
            autopilot.alive = False
            await testbed.close()

    run_simulated(run)


def by_name(received):
    return {(message.component, message.name): message for message in received.messages}


def test_every_message_has_rate_age_and_fields_as_they_came(run_simulated):
    async def scenario(vehicle, inspector, autopilot):
        assert inspector.received().messages == ()
        await asyncio.sleep(6.5)
        received = inspector.received()
        attitude = by_name(received)[(1, "ATTITUDE")]
        assert attitude.rate_hz == pytest.approx(attitude.count / received.since_s, rel=0.1)
        assert attitude.age_s < 0.2
        assert list(attitude.fields) == [field.name for field in definition("ATTITUDE").fields]
        assert attitude.fields["roll"] == pytest.approx(vehicle.topic("attitude").value.roll_rad, abs=0.01)
        assert by_name(received)[(1, "HEARTBEAT")].rate_hz == pytest.approx(1.0, rel=0.2)
        assert [(loss.component, loss.lost) for loss in received.loss if loss.component == 1] == [(1, 0)]

    run_with_inspector(run_simulated, scenario)


def test_loss_is_counted_and_the_rate_of_what_stops_falls(run_simulated):
    async def scenario(vehicle, inspector, autopilot):
        inspector.received()
        await asyncio.sleep(5)
        (loss,) = [each for each in inspector.received().loss if each.component == 1]
        assert loss.lost / (loss.received + loss.lost) == pytest.approx(0.2, abs=0.06)
        autopilot.loss = 1.0
        before = by_name(inspector.received())[(1, "ATTITUDE")].rate_hz
        await asyncio.sleep(3)
        after = by_name(inspector.received())[(1, "ATTITUDE")]
        assert after.rate_hz < 0.75 * before
        assert after.age_s == pytest.approx(3, abs=0.2)

    run_with_inspector(run_simulated, scenario, loss=0.2)


def test_nothing_is_counted_while_nobody_looks(run_simulated):
    async def scenario(vehicle, inspector, autopilot):
        assert vehicle.taps == ()
        inspector.received()
        assert vehicle.taps
        await asyncio.sleep(IDLE_S + 5)
        assert vehicle.taps == ()
        assert inspector.received().messages == ()

    run_with_inspector(run_simulated, scenario)


def live(inspector, *fields, after=0):
    return live_values(inspector, 1, fields, after)


def test_a_plotted_field_has_every_value_once_and_what_is_kept_is_bounded(run_simulated, monkeypatch):
    monkeypatch.setattr(inspector_module, "MAX_MESSAGES", 5)
    monkeypatch.setattr(inspector_module, "MAX_FOLLOWED", 2)

    async def scenario(vehicle, inspector, autopilot):
        live(inspector, ROLL)
        await asyncio.sleep(2)
        first = live(inspector, ROLL, "ATTITUDE:1.1/yaw")
        roll, yaw = first.series
        assert len(roll.t_s) > 10
        assert len(roll.values) == len(yaw.values) == len(roll.t_s)
        assert (roll.unit, roll.gap, first.more) == ("rad", False, False)
        await asyncio.sleep(1)
        then = live(inspector, ROLL, after=first.after)
        assert then.series[0].t_s[0] > roll.t_s[-1]
        whole = live(inspector, ROLL)
        assert whole.series[0].t_s == [*roll.t_s, *then.series[0].t_s]
        live(inspector, "SERVO_OUTPUT_RAW:1.1/servo1_raw")
        live(inspector, "BATTERY_STATUS:1.1/voltages[0]")
        assert len(inspector._followed) == 2
        received = inspector.received()
        assert received.system == 1
        assert len(received.messages) == 5
        assert received.left_out > 0

    run_with_inspector(run_simulated, scenario)


def test_a_wrong_number_or_sender_is_named(run_simulated):
    async def scenario(vehicle, inspector, autopilot):
        for field, text in (
            ("ATTITUDE:1.1/rol", "no number"),
            ("ATTITUDE:1.1/roll[0]", "no number"),
            ("BATTERY_STATUS:1.1/voltages", "no number"),
            ("BATTERY_STATUS:1.1/voltages[10]", "no number"),
            ("STATUSTEXT:1.1/text", "no number"),
            ("NO_MESSAGE:1.1/roll", "no message"),
            ("ATTITUDE:2.1/roll", "system of this vehicle is 1"),
            ("ATTITUDE:1/roll", "not of the form"),
            ("ATTITUDE:1.1", "not of the form"),
            ("exec({ATTITUDE:1.1/roll})", "no function"),
            ("{ATTITUDE:1.1/roll}.real", "not allowed"),
            ("{" * 400, "fields in braces"),
        ):
            with pytest.raises(InvalidRequest, match=text):
                live(inspector, field)

    run_with_inspector(run_simulated, scenario)


def test_expressions_are_those_of_a_log_over_several_answers(run_simulated):
    degrees, slope = f"degrees({{{ROLL}}})", "derivative({LOCAL_POSITION_NED:1.1/x})"
    mixed = f"{{{ROLL}}} + {{LOCAL_POSITION_NED:1.1/x}} * 0"

    async def scenario(vehicle, inspector, autopilot):
        after, parts = 0, []
        for _ in range(4):
            answer = live(inspector, ROLL, degrees, slope, mixed, after=after)
            after = answer.after
            parts.append(answer)
            await asyncio.sleep(0.3)
        parts.append(live(inspector, ROLL, degrees, slope, mixed, after=after))
        at_once = live(inspector, ROLL, degrees, slope, mixed)
        assert [each.unit for each in at_once.series] == ["rad", "°", "m/s", "rad"]
        for i in (0, 1, 3):
            joined = [value for part in parts[1:] for value in part.series[i].values]
            assert joined == pytest.approx(at_once.series[i].values[-len(joined) :])
        slopes = [value for part in parts[1:] for value in part.series[2].values]
        assert None not in slopes[1:]
        assert at_once.series[2].values[-1] == pytest.approx(slopes[-1])

    run_with_inspector(run_simulated, scenario)


def test_one_answer_is_bounded_and_the_next_ones_have_the_rest(run_simulated, monkeypatch):
    monkeypatch.setattr(live_module, "MAX_FRAMES", 7)

    async def scenario(vehicle, inspector, autopilot):
        fields = (ROLL, "LOCAL_POSITION_NED:1.1/x")
        live(inspector, *fields)
        await asyncio.sleep(2)
        times, after, more = [[], []], 0, True
        while more:
            answer = live(inspector, *fields, after=after)
            assert sum(len(each.t_s) for each in answer.series) <= 7
            for all_s, each in zip(times, answer.series, strict=True):
                all_s += each.t_s
            after, more = answer.after, answer.more
        monkeypatch.setattr(live_module, "MAX_FRAMES", 1500)
        assert times == [each.t_s for each in live(inspector, *fields).series]

    run_with_inspector(run_simulated, scenario)


def test_values_that_were_not_kept_are_a_gap(run_simulated, monkeypatch):
    monkeypatch.setattr(inspector_module, "MAX_FRAMES", 20)

    async def scenario(vehicle, inspector, autopilot):
        first = live(inspector, ROLL)
        await asyncio.sleep(0.2)
        soon = live(inspector, ROLL, after=first.after)
        assert not soon.series[0].gap
        await asyncio.sleep(5)  # more than is kept
        late = live(inspector, ROLL, after=soon.after)
        assert late.series[0].gap
        await asyncio.sleep(IDLE_S + 5)  # nobody has asked
        assert live(inspector, ROLL, after=late.after).series[0].gap
        await asyncio.sleep(0.2)
        ended = live(inspector, ROLL, after=10**9)  # of a server that was started again
        assert ended.after < 10**9
        assert ended.series[0].values

    run_with_inspector(run_simulated, scenario)


def test_instances_of_a_message_are_apart(run_simulated):
    batteries = [f"BATTERY_STATUS:1.77{instance}/battery_remaining" for instance in (".0", ".1", "")]
    link = {"connection": SimpleNamespace(name="a"), "peer": SimpleNamespace(name="b")}
    endpoint = SimpleNamespace(over_ros2=False, **link)

    async def scenario(vehicle, inspector, autopilot):
        live(inspector, *batteries)
        for seq, (number, percent) in enumerate(((0, 90), (1, 50), (0, 89))):
            payload = payload_of("BATTERY_STATUS", {"id": number, "battery_remaining": percent})
            raw = encode_frame(d.MAVLINK_MSG_ID_BATTERY_STATUS, payload, seq, 1, 77)
            inspector.take(
                Frame(d.MAVLINK_MSG_ID_BATTERY_STATUS, 1, 77, seq, raw, inspector.now_s()), endpoint
            )
        assert [each.values for each in live(inspector, *batteries).series] == [[90, 89], [50], [90, 50, 89]]
        kind = by_name(inspector.received())[(77, "BATTERY_STATUS")]
        assert (kind.instance, kind.instances) == (0, (0, 1))

    run_with_inspector(run_simulated, scenario)


def test_any_message_can_be_built_and_described():
    for name in IDS:
        described = definition(name)
        layout = LAYOUTS[described.id]
        assert payload_of(name, {}) == bytes(layout.unpacker.size)
        values = {}
        for field in described.fields:
            value = "a" if field.type == "char" else 1
            values[field.name] = [value] * field.length if field.length and field.type != "char" else value
        assert len(payload_of(name, values)) == layout.unpacker.size


def test_a_wrong_field_is_named():
    for name, fields, text in (
        ("NO_MESSAGE", {}, "no message"),
        ("PING", {"sequence": 1}, "no such field"),
        ("PING", {"seq": -1}, "whole number from 0"),
        ("PING", {"seq": 1.5}, "whole number"),
        ("PING", {"seq": True}, "whole number"),
        ("PING", {"seq": None}, "whole number"),
        ("ATTITUDE", {"roll": "x"}, "a number"),
        ("ATTITUDE", {"roll": 1e39}, "float"),
        ("ATTITUDE", {"roll": float("inf")}, "a number"),
        ("STATUSTEXT", {"text": "x" * 51}, "at most 50"),
        ("STATUSTEXT", {"text": "ü"}, "ASCII"),
        ("PLAY_TUNE", {"tune": 1}, "a text"),
        ("BATTERY_STATUS", {"voltages": [1] * 11}, "at most 10"),
        ("BATTERY_STATUS", {"voltages": 1}, "a list"),
    ):
        with pytest.raises(InvalidRequest, match=text):
            payload_of(name, fields)


def test_a_message_is_sent_once_and_a_command_has_its_answer(run_simulated):
    async def scenario(vehicle, inspector, autopilot):
        messages = vehicle.service(RawMessages)
        request = {"command": d.MAV_CMD_REQUEST_MESSAGE, "param1": d.MAVLINK_MSG_ID_AUTOPILOT_VERSION}
        before = autopilot.count(d.MAVLINK_MSG_ID_COMMAND_LONG)
        assert await messages.send("COMMAND_LONG", request) == (True, d.MAV_RESULT_ACCEPTED)
        assert autopilot.count(d.MAVLINK_MSG_ID_COMMAND_LONG) == before + 1
        assert await messages.send("PING", {"seq": 3}) == (False, None)
        autopilot.loss = 1.0
        assert await messages.send("COMMAND_LONG", request) == (True, None)

    run_with_inspector(run_simulated, scenario)


def test_what_has_a_command_of_its_own_is_refused_with_its_name(run_simulated):
    calls = {*raw_messages.PURPOSE_MADE.values(), *raw_messages.PURPOSE_MADE_COMMANDS.values()}
    known = {call.replace("/api/v1", "") for call in BY_CALL}
    assert calls <= known

    async def scenario(vehicle, inspector, autopilot):
        messages = vehicle.service(RawMessages)
        received = len(autopilot.received_frames)
        for name in raw_messages.PURPOSE_MADE:
            with pytest.raises(Refused, match="a command of its own"):
                await messages.send(name, {}, while_armed=True)
        for name in raw_messages.COMMANDS:
            for command in raw_messages.PURPOSE_MADE_COMMANDS:
                with pytest.raises(Refused, match="a command of its own"):
                    await messages.send(name, {"command": command}, while_armed=True)
        with pytest.raises(InvalidRequest, match="whose system id is 1"):
            await messages.send("PING", {"target_system": 0})
        assert len(autopilot.received_frames) == received

    run_with_inspector(run_simulated, scenario)


def test_a_message_needs_its_confirmation_and_while_armed_the_wish(run_simulated):
    def request(**more):
        body = {
            "message": "PING",
            "fields": {"seq": 1},
            "confirm": "PING is sent unchecked to vehicle 1",
            **more,
        }
        return inspector_routes.RawMessage.model_validate(body)

    async def scenario(rig):
        station = rig.station
        with pytest.raises(InvalidRequest, match="not the required text"):
            await inspector_routes.send("1", request(confirm="yes"), station, ANNA)
        with pytest.raises(Refused, match="is armed"):
            await inspector_routes.send("1", request(), station, ANNA)
        answer = json_of(await inspector_routes.send("1", request(while_armed=True), station, ANNA))
        assert answer == {"acknowledged": None, "result": None}
        results = sorted(entry[3] for entry in journal_entries(station) if entry[1] == "mavlink/send")
        assert results == ["invalid_request", "ok", "refused"]

    run_with_routes(run_simulated, scenario)
