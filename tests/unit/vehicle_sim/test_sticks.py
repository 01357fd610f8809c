"""Flight by MANUAL_CONTROL: the effect of the sticks in each mode, and when PX4 ignores them."""

import math

import numpy as np
import pytest

from tests.unit.vehicle_sim.sim_station import ARM_DISARM, DO_SET_MODE, POSITION_MODE, Station
from vehicle_sim.geodesy import to_global

pytestmark = pytest.mark.flight

ALTITUDE, STABILIZED, ACRO = 0x20000, 0x70000, 0x50000
MAIN_MODES = {POSITION_MODE: 3, ALTITUDE: 2, STABILIZED: 7, ACRO: 5}
STREAMED_IDS = {0, 1}
"""HEARTBEAT and SYS_STATUS: other streams would take more computing time than the flight."""


class JoystickStation(Station):
    """A station with a joystick that sends 20 messages per second."""

    def __init__(self, **fleet):
        super().__init__(sensor_noise=False, **fleet)
        for link in self.sim.nodes[0].context.links:
            for msg_id in set(link.streamed_ids()) - STREAMED_IDS:
                link.set_interval(msg_id, 0, 0)
        self.sticks = {"x": 0, "y": 0, "z": 500, "r": 0}
        self.next_send_s = 0.0

    def fly(self, seconds, **sticks):
        self.sticks |= sticks
        self.run(seconds, self.send_sticks)

    def send_sticks(self):
        if self.now_s >= self.next_send_s:
            self.send("MANUAL_CONTROL", target=self.system_id, **self.sticks)
            self.next_send_s = self.now_s + 0.05

    def reposition(self):
        """Flies to 10 m above home at its current horizontal position, heading north."""
        home = self.sim.simulation.origin
        north, east, _ = self.position_m
        lat, lon = to_global(north, east, home.lat_deg, home.lon_deg)
        self.send(
            "COMMAND_INT",
            target_system=self.system_id,
            target_component=1,
            command=192,
            param1=-1.0,
            param2=1.0,
            param4=0.0,
            x=round(float(lat) * 1e7),
            y=round(float(lon) * 1e7),
            z=home.alt_amsl_m + 10.0,
        )
        self.fly(1.0)
        self.run_until(lambda: self.hovers_at(north, east), 60, lambda: self.fly(0.02))

    def hovers_at(self, north, east):
        distance_m = np.abs(self.position_m - (north, east, -10.0)).max()
        return distance_m < 0.5 and np.abs(self.velocity_m_s).max() < 0.05 and abs(self.euler_rad[2]) < 0.02

    def switch_mode(self, mode):
        self.command(DO_SET_MODE, 1, MAIN_MODES[mode])
        self.fly(0.3)
        assert self.active_mode == mode

    @property
    def position_m(self):
        return self.sim.simulation.truth.position_ned_m[0].copy()

    @property
    def velocity_m_s(self):
        return self.sim.simulation.truth.velocity_ned_m_s[0]

    @property
    def euler_rad(self):
        estimate = self.sim.autopilots[0].view.estimate
        return estimate.roll_rad, estimate.pitch_rad, estimate.yaw_ned_rad


@pytest.fixture(scope="module")
def flying_station():
    station = JoystickStation()
    station.take_off_and_hover(10.0)
    return station


@pytest.fixture
def pilot(flying_station):
    """A vehicle in Hold at 10 m with centred sticks; all tests use the same flight."""
    flying_station.sticks = {"x": 0, "y": 0, "z": 500, "r": 0}
    flying_station.fly(0.5)
    flying_station.command(DO_SET_MODE, 1, 4, 3)
    flying_station.fly(2.5)
    flying_station.reposition()
    return flying_station


@pytest.mark.story
def test_in_position_the_stick_sets_the_speed_and_the_vehicle_stops_when_the_stick_is_centred(pilot):
    pilot.switch_mode(POSITION_MODE)
    pilot.fly(8.0, x=1000)
    assert pilot.velocity_m_s[0] == pytest.approx(10.0, abs=2.0), "not MPC_VEL_MANUAL minus drag"
    assert abs(pilot.velocity_m_s[1]) < 0.3
    pilot.fly(10.0, x=0)
    stopped_ned_m = pilot.position_m
    pilot.fly(3.0)
    assert np.abs(pilot.position_m - stopped_ned_m).max() < 0.5
    assert pilot.height_m == pytest.approx(10.0, abs=0.7)


def test_a_stick_within_the_dead_zone_has_no_effect(pilot):
    pilot.switch_mode(POSITION_MODE)
    pilot.fly(4.0, x=90, y=-90, r=90, z=545)
    assert np.abs(pilot.velocity_m_s).max() < 0.1


def test_throttle_sets_the_climb_rate_and_a_centred_stick_keeps_the_altitude(pilot):
    pilot.switch_mode(ALTITUDE)
    pilot.fly(3.0, z=1000)
    assert -pilot.velocity_m_s[2] == pytest.approx(3.0, abs=0.5), "the climb rate is not MPC_Z_VEL_MAX_UP"
    pilot.fly(4.0, z=500)
    hover_height_m = pilot.height_m
    pilot.fly(4.0)
    assert pilot.height_m == pytest.approx(hover_height_m, abs=0.2)


def test_in_altitude_the_stick_sets_the_tilt_and_the_position_is_not_kept(pilot):
    pilot.switch_mode(ALTITUDE)
    pilot.fly(2.0, y=1000)
    assert math.degrees(pilot.euler_rad[0]) == pytest.approx(35.0, abs=3.0), "not MPC_MAN_TILT_MAX"
    assert pilot.velocity_m_s[1] > 3.0
    pilot.fly(1.0, y=0)
    assert abs(math.degrees(pilot.euler_rad[0])) < 3.0
    assert pilot.velocity_m_s[1] > 0.5, "the vehicle was stopped"


def test_the_yaw_stick_sets_the_yaw_rate_and_a_centred_stick_keeps_the_heading(pilot):
    pilot.switch_mode(POSITION_MODE)
    pilot.fly(1.0, r=500)
    assert pilot.euler_rad[2] > math.radians(10.0)
    pilot.fly(2.0, r=0)
    heading_rad = pilot.euler_rad[2]
    pilot.fly(3.0)
    assert pilot.euler_rad[2] == pytest.approx(heading_rad, abs=math.radians(1.0))


def test_in_stabilized_sticks_set_attitude_and_thrust(pilot):
    pilot.switch_mode(STABILIZED)
    pilot.fly(1.5, x=500)
    assert math.degrees(pilot.euler_rad[1]) == pytest.approx(-17.5, abs=1.5)
    # centred throttle is the estimated hover thrust, which changes slightly after fast flight
    assert float(pilot.sim.simulation.target.thrust[0]) == pytest.approx(0.49, abs=0.04)
    pilot.fly(0.3, x=0, z=1000)
    assert float(pilot.sim.simulation.target.thrust[0]) == pytest.approx(1.0, abs=0.01)


def test_in_acro_sticks_set_body_rates(pilot):
    pilot.switch_mode(ACRO)
    pilot.fly(0.4, y=300)
    rates = pilot.sim.simulation.truth.rates_frd_rad_s[0]
    assert math.degrees(rates[0]) == pytest.approx(30.0, abs=4.0), "not 30 % of MC_ACRO_R_MAX"


@pytest.mark.story
def test_the_throttle_stick_takes_off_and_lands():
    pilot = JoystickStation()
    pilot.run_until(lambda: pilot.can_be_armed, 15)
    pilot.fly(0.5, z=0)
    pilot.switch_mode(POSITION_MODE)
    pilot.command(ARM_DISARM, 1)
    pilot.fly(2.0)
    assert pilot.armed
    assert pilot.height_m < 0.05, "the vehicle took off with low throttle"
    pilot.fly(6.0, z=900)
    assert pilot.height_m > 2.0
    pilot.fly(2.0, z=500)
    pilot.run_until(lambda: not pilot.armed, 60, lambda: pilot.fly(0.02, z=0))
    assert pilot.height_m < 0.05


def test_in_gaps_between_stick_messages_the_vehicle_keeps_its_altitude_and_then_continues_its_climb():
    """The station sends sticks for half a second, then none for a second; the failsafe for lost sticks is
    disabled."""
    pilot = JoystickStation(parameters={"NAV_RCL_ACT": 0})
    pilot.run_until(lambda: pilot.can_be_armed, 15)
    pilot.fly(0.5, z=0)
    pilot.switch_mode(POSITION_MODE)
    pilot.command(ARM_DISARM, 1)
    pilot.fly(2.0)
    pilot.sticks["z"] = 900
    heights_m = []
    for _ in range(8):
        pilot.fly(0.5)
        pilot.run(0.8)
        height_in_gap_m = pilot.height_m
        pilot.run(0.2)
        heights_m.append(pilot.height_m)
        assert heights_m[-1] >= height_in_gap_m - 0.05, "the vehicle descended in a gap"
    assert heights_m[-1] > 6.0
    assert heights_m[-1] - heights_m[-2] > 1.0


def test_lost_sticks_trigger_the_failsafe(pilot):
    pilot.switch_mode(POSITION_MODE)
    lost_at_s = pilot.now_s
    pilot.run(3.0)
    assert pilot.active_mode != POSITION_MODE, "NAV_RCL_ACT has no effect"
    assert any("Failsafe" in text for text in pilot.status_texts(lost_at_s))


def test_in_hold_a_moved_stick_takes_over_and_centred_sticks_do_not(pilot):
    pilot.fly(2.0)
    assert pilot.active_mode != POSITION_MODE
    pilot.fly(0.5, x=600)
    assert pilot.active_mode == POSITION_MODE
    assert any("took over" in text for text in pilot.status_texts())


def test_sticks_for_other_vehicles_and_disabled_sticks_are_ignored(pilot):
    received_before_s = pilot.sim.autopilots[0].sticks.received_at_s
    pilot.send("MANUAL_CONTROL", target=99, x=0, y=0, z=500, r=0)
    pilot.sim.autopilots[0].view.parameters.set("COM_RC_IN_MODE", 4)
    pilot.send("MANUAL_CONTROL", target=pilot.system_id, x=0, y=0, z=500, r=0)
    assert pilot.sim.autopilots[0].sticks.received_at_s == received_before_s
