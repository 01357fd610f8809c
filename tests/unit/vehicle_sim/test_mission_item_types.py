"""Mission uploads from a ground station that supports one type of mission item, and message intervals."""

from __future__ import annotations

from tests.unit.vehicle_sim.plan_station import PlanStation
from vehicle_sim.px4_version import V1_16

UNSUPPORTED = 3
MESSAGE_INTERVAL = 511


def test_an_upload_continues_with_the_item_type_that_the_sender_supports() -> None:
    station = PlanStation(px4=V1_16)  # its first request after a boot is for floats
    station.run(1.0)
    station.send("MISSION_COUNT", target_system=1, target_component=1, count=1, mission_type=0)
    station.run(0.1)
    assert len(station.received("MISSION_REQUEST")) == 1
    station.send("MISSION_ACK", target_system=1, target_component=1, type=UNSUPPORTED, mission_type=0)
    station.run(0.1)
    assert (len(station.received("MISSION_REQUEST")), len(station.received("MISSION_REQUEST_INT"))) == (1, 1)


def test_intervals_are_accepted_for_messages_without_data_and_for_the_simulated_truth() -> None:
    station = PlanStation()
    station.run(1.0)
    for message_id in (65, 115, 375):  # RC_CHANNELS, HIL_STATE_QUATERNION, ACTUATOR_OUTPUT_STATUS
        station.command(MESSAGE_INTERVAL, message_id, 100_000)
    station.run(1.0)
    assert station.acks(MESSAGE_INTERVAL) == [0, 0, 0]
    truth, outputs = station.received("HIL_STATE_QUATERNION"), station.received("ACTUATOR_OUTPUT_STATUS")
    assert len(truth) in (9, 10)
    assert truth[-1].alt == 489400
    assert outputs[-1].actuator[:5] == [900.0] * 5
    assert station.received("RC_CHANNELS") == []
