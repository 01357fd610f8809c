"""Flights towards an obstacle: a collision, a stop in front of the obstacle, a flight over it, and sensors
that stop sending."""

import asyncio

import pytest

from gcs_server.errors import Refused
from gcs_server.mavlink import dialect as d
from gcs_server.streamer.values.limit_values import OperatorLimits
from gcs_server.streamer.values.stream_request import StreamRequest
from missions.setpoints import Path, PathPoint, Position
from tests.protocol.command_numbers import SET_MESSAGE_INTERVAL
from tests.protocol.offboard_testbed import offboard_event_codes
from tests.protocol.simulated_testbed import SimulatedTestbed, until
from tests.unit.vehicle_sim.prepared_stations import station_in_hover
from tests.unit.vehicle_sim.sim_station import Station
from vehicle_sim.world.files import load_world

GOAL_NED_M = (10.0, 0.0, -2.0)
BOX_NORTH_M = (4.25, 5.75)
SENSOR_MESSAGE_IDS = (d.MAVLINK_MSG_ID_DISTANCE_SENSOR, d.MAVLINK_MSG_ID_OBSTACLE_DISTANCE)


def request_to(position_ned_m, valid_for_s=120.0):
    return StreamRequest(Position(position_ned_m, 0.0), valid_for_s, client="test")


class Flight:
    """A flight in Offboard in front of the box, heading north."""

    def __init__(self, testbed, vehicle):
        self.testbed, self.vehicle, self.offboard = testbed, vehicle, vehicle.offboard
        self.truth = testbed.sim.simulation.truth
        self.track = []
        """North, east and down [m], and whether a collision is reported, ten times a second."""
        self.recording_task = None

    async def begin(self):
        await self.offboard.start(request_to((0.0, 0.0, -2.0)))
        await until(lambda: abs(self.position_ned_m[2] + 2.0) < 0.2 and abs(self.position_ned_m[0]) < 0.3, 20)
        self.recording_task = asyncio.ensure_future(self.record_track())

    async def record_track(self):
        while True:
            self.track.append((*self.position_ned_m, self.collision_is_reported()))
            await asyncio.sleep(0.1)

    def collision_is_reported(self):
        return any("Collision" in event.text for event in self.vehicle.events.since())

    @property
    def position_ned_m(self):
        return tuple(self.truth.position_ned_m[0].tolist())

    @property
    def avoidance(self):
        return self.offboard.status().avoidance

    def is_near(self, position_ned_m, within_m=0.5):
        return all(abs(a - b) < within_m for a, b in zip(self.position_ned_m, position_ned_m, strict=True))

    def max_height_over_box_m(self):
        return max(-down for north, _, down, _ in self.track if BOX_NORTH_M[0] <= north <= BOX_NORTH_M[1])

    def has_never_collided(self):
        return not any(collided for *_, collided in self.track)

    def set_sensor_interval(self, interval_us=-1.0):
        """Requests the messages of the obstacle sensors at this interval; -1: no messages."""
        for msg_id in SENSOR_MESSAGE_IDS:
            self.vehicle.send(
                d.MAVLink_command_long_message(
                    1, 1, SET_MESSAGE_INTERVAL, 0, float(msg_id), interval_us, 0, 0, 0, 0, 0
                )
            )


def run_at_the_box(run_simulated, scenario):
    async def run():
        station = station_in_hover(Station, 2.0, links=(("gcs", "gcs"),), world=load_world("obstacle-box"))
        testbed = SimulatedTestbed(sim=station.sim)
        try:
            vehicle = await testbed.wait_for_vehicle()
            flight = Flight(testbed, vehicle)
            await flight.begin()
            try:
                await scenario(flight)
            finally:
                flight.recording_task.cancel()
        finally:
            await testbed.close()

    run_simulated(run)


@pytest.mark.story
def test_without_avoidance_and_brake_the_straight_path_hits_the_box(run_simulated):
    async def scenario(flight):
        await flight.offboard.operator_limits.set(OperatorLimits(obstacle_brake=False), by="test")
        await flight.offboard.setpoint(request_to(GOAL_NED_M))
        await until(lambda: not flight.has_never_collided(), 30)
        assert flight.position_ned_m[0] < BOX_NORTH_M[0]

    run_at_the_box(run_simulated, scenario)


@pytest.mark.story
def test_the_brake_stops_before_the_box_and_avoidance_enabled_in_flight_flies_over_it(run_simulated):
    async def scenario(flight):
        offboard = flight.offboard
        await offboard.setpoint(request_to(GOAL_NED_M))
        await asyncio.sleep(10)
        status = offboard.status()
        assert status.limited == ("position limited to stop before an obstacle",)
        assert (status.state, status.avoidance.state, status.avoidance.sensor) == ("streaming", None, True)
        assert 2.0 < flight.position_ned_m[0] < 3.6
        await offboard.avoidance.switch_on("over")
        await until(lambda: flight.avoidance.state == "over", 5)
        assert "climbing over" in flight.avoidance.text
        await until(lambda: flight.avoidance.state == "clear" and flight.is_near(GOAL_NED_M), 60)
        assert flight.has_never_collided()
        assert 4.4 < flight.max_height_over_box_m() < 7.0
        assert offboard_event_codes(flight.vehicle).count("avoidance") >= 2
        offboard.avoidance.switch_off()
        await until(lambda: flight.avoidance.state is None, 2)

    run_at_the_box(run_simulated, scenario)


@pytest.mark.story
def test_avoidance_flies_around_the_box_and_rejoins_the_path_behind_it(run_simulated):
    async def scenario(flight):
        await flight.offboard.avoidance.switch_on("around")
        points = tuple(PathPoint(t, (1.5 * t, 0.0, -2.0), 0.0) for t in (0.0, 6.0, 12.0))
        await flight.offboard.setpoint(StreamRequest(Path(points), 60.0, client="test"))
        await until(lambda: flight.avoidance.state == "around", 20)
        await until(lambda: flight.avoidance.state == "clear" and flight.is_near((18.0, 0.0, -2.0)), 60)
        assert flight.has_never_collided()
        assert max(-down for _, _, down, _ in flight.track) < 3.0
        assert max(abs(east) for _, east, _, _ in flight.track) > 2.5

    run_at_the_box(run_simulated, scenario)


@pytest.mark.story
def test_the_vehicle_stops_while_its_obstacle_sensors_send_nothing(run_simulated):
    async def scenario(flight):
        await flight.offboard.avoidance.switch_on("over")
        await flight.offboard.setpoint(request_to(GOAL_NED_M))
        await until(lambda: flight.avoidance.state == "over", 20)
        flight.offboard.avoidance.request_rates = lambda: None
        flight.set_sensor_interval()
        await until(lambda: flight.avoidance.state == "stopped", 5)
        assert "No obstacle" in flight.avoidance.text
        await asyncio.sleep(5)
        hold_setpoint = flight.offboard.status().setpoint
        assert hold_setpoint["type"] == "position"
        await asyncio.sleep(3)
        assert flight.offboard.status().setpoint == hold_setpoint
        assert "avoidance_stopped" in offboard_event_codes(flight.vehicle)
        flight.set_sensor_interval(2e5)
        await until(lambda: flight.is_near(GOAL_NED_M), 60)
        assert flight.has_never_collided()

    run_at_the_box(run_simulated, scenario)


def test_without_a_sensor_avoidance_is_refused_and_no_stream_starts(run_simulated):
    async def run():
        testbed = SimulatedTestbed(sim=station_in_hover(Station, 2.0, links=(("gcs", "gcs"),)).sim)
        try:
            vehicle = await testbed.wait_for_vehicle()
            with pytest.raises(Refused, match="no obstacle sensor") as refused:
                await vehicle.offboard.avoidance.switch_on("over")
            assert "DISTANCE_SENSOR" in refused.value.remedy
            assert not vehicle.offboard.status().avoidance.on
            vehicle.offboard.avoidance.way = "over"  # as if the sensor had failed after avoidance was enabled
            with pytest.raises(Refused, match="no obstacle sensor"):
                await vehicle.offboard.start(request_to((0.0, 0.0, -10.0)))
            assert vehicle.status.mode == "hold"
        finally:
            await testbed.close()

    run_simulated(run)
