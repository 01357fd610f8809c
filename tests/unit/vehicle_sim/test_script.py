"""Fault scripts: each event occurs once, at its time or in its state, and affects only the named vehicles."""

import math

import pytest

from tests.unit.vehicle_sim.sim_station import GCS_AND_API_LINKS, Station
from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.script import script_from_fields
from vehicle_sim.yaml_fields import FileProblem, parse_yaml

pytestmark = pytest.mark.flight


def script(*events):
    return script_from_fields(
        parse_yaml("name: test\nevents:\n" + "".join(f"  - {{{e}}}\n" for e in events), "test.yaml")
    )


def test_gps_is_lost_and_restored_at_the_scripted_times():
    sim = SimulatedFleet(script=script("at_s: 2, gps: lost", "at_s: 3.5, gps: ok"))
    fixes = []
    for _ in range(50):
        sim.step(0.1)
        fixes.append((round(sim.time_s, 1), int(sim.simulation.sensors.gps_fix_type[0])))
    assert all(fix == 3 for t, fix in fixes if 0.5 < t < 2.0 or t > 3.8)
    assert all(fix < 3 for t, fix in fixes if 2.2 < t < 3.5)


@pytest.mark.story
def test_an_event_when_airborne_occurs_after_the_take_off():
    station = Station(
        script=script("when: airborne, after_s: 2, battery_percent: 40, wind_ned_m_s: [0, 6, 0]")
    )
    station.run(15)
    assert station.sim.simulation.battery.remaining[0] == 1.0, "the event occurred on the ground"
    station.take_off_and_hover(5.0)
    station.run(6.0)
    assert station.sim.simulation.battery.remaining[0] <= 0.4
    assert not station.sim.simulation.truth.on_ground[0]


def test_an_event_above_a_height_stops_a_motor_of_the_named_vehicle_only():
    sim = SimulatedFleet(2, script=script("above_m: 5, vehicles: [2], motor: {number: 3}"))
    sim.simulation.truth.position_ned_m[:, 2] = -20.0
    sim.step(0.1)
    assert sim.simulation.motor_health.tolist() == [[1, 1, 1, 1], [1, 1, 0, 1]]


def test_a_link_that_is_down_sends_nothing_until_it_is_up_again():
    station = Station(
        script=script("at_s: 3, link: {name: gcs, up: false}", "at_s: 6, link: {name: gcs, up: true}"),
        links=GCS_AND_API_LINKS,
    )
    station.run(9.0)
    heartbeat_times_s = [t for t, link, m in station.log if link == "gcs" and m.name == "HEARTBEAT"]
    assert min(heartbeat_times_s) < 3
    assert max(heartbeat_times_s) > 6
    assert not [t for t in heartbeat_times_s if 3.1 < t < 6.0]
    assert [t for t, link, _ in station.log if link == "api" and 3.1 < t < 6.0], (
        "the other link was also down"
    )


def test_an_event_at_landing_needs_a_previous_flight_and_a_scripted_parameter_is_set():
    sim = SimulatedFleet(
        script=script("when: landed, gps: lost", "at_s: 1, parameter: {name: MPC_XY_CRUISE, value: 3}")
    )
    sim.step(2.0)
    assert sim.simulation.sensors.gps_fix_type[0] == 3, "the event occurred before a flight"
    assert sim.simulation.parameters[0].get("MPC_XY_CRUISE") == 3.0


def test_a_gps_offset_moves_the_gps_position():
    sim = SimulatedFleet(script=script("at_s: 2, gps_offset_ned_m: [100, 0, 0]"), sensor_noise=False)
    sim.step(1.9)
    lat_before_deg = float(sim.simulation.sensors.gps_lat_deg[0])
    sim.step(1.0)
    moved_m = math.radians(float(sim.simulation.sensors.gps_lat_deg[0]) - lat_before_deg) * 6371000.0
    assert moved_m == pytest.approx(100.0, abs=0.1)


@pytest.mark.parametrize(
    ("event", "expected"),
    [
        ("gps: lost", "events[0] needs one of at_s, when, above_m"),
        ("at_s: 1, when: armed, gps: lost", "needs one of"),
        ("at_s: 1", "does nothing; give one of gps"),
        ("at_s: , gps: lost", "at_s"),
        ("above_m: , gps: lost", "above_m"),
        ("at_s: -1, gps: lost", "events[0].at_s is -1; give a number from 0"),
        ("at_s: 1, gps: off", "gps is 'off'; give one of ok, lost, stuck"),
        ("when: bored, gps: ok", "give one of armed, disarmed"),
        ("at_s: 1, motor: {number: 5}", "motor.number is 5; give a number from 1 to 4"),
        ("at_s: 1, battery_percent: 101", "from 0 to 100"),
        ("at_s: 1, link: {name: radio}", "give one of gcs, api, tcp, all"),
        ("at_s: 1, parameter: {name: NOPE, value: 1}", "events[0].parameter.name cannot be set"),
        ("at_s: 1, gps: ok, wnid_ned_m_s: [1, 2, 3]", "wnid_ned_m_s is not known"),
        ("at_s: 1, vehicles: [], gps: ok", "a list of system ids"),
    ],
)
def test_the_error_about_an_invalid_event_names_field_and_line(event, expected):
    with pytest.raises(FileProblem) as problem:
        script(event)
    assert expected in str(problem.value)
    assert "test.yaml line 3" in str(problem.value)
