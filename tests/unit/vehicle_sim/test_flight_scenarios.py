"""Whole flights by MAVLink messages, on simulated time."""

import math

import pytest

from tests.unit.vehicle_sim.prepared_stations import station_in_hover
from tests.unit.vehicle_sim.sim_station import (
    GCS_AND_API_LINKS,
    HOLD_MODE,
    LAND_MODE,
    NAN,
    OFFBOARD_MODE,
    POSITION_MODE,
    RTL_MODE,
    TAKEOFF_MODE,
    Station,
)
from vehicle_sim.px4_version import V1_16, V1_17, Px4Version

pytestmark = pytest.mark.flight

M_PER_DEG = 111_195  # of latitude

ARM, TAKEOFF_COMMAND, LAND_COMMAND, SET_MODE, REPOSITION, RETURN = 400, 22, 21, 176, 192, 20
TERMINATE, AUTOTUNE, FORCE, ALTITUDE, TERMINATION = 185, 212, 21196, 0x20000, 0x0A0000


def test_a_vehicle_flies_from_boot_to_landing() -> None:
    station = Station()
    assert station.run_until(lambda: station.can_be_armed, 10) < 10

    armed_s = station.now_s
    station.command(ARM, 1)
    station.run(0.1)
    assert station.armed
    assert station.acks(ARM) == [0]
    assert station.status_texts() == ["Armed by external command\t"]
    assert "commander_armed_by" in station.events()

    station.command(TAKEOFF_COMMAND, -1, 0, 0, NAN, NAN, NAN, station.sim.autopilots[0].home.alt_amsl_m + 10)
    station.run(0.1)
    assert station.acks(TAKEOFF_COMMAND) == [0]
    assert station.active_mode == TAKEOFF_MODE
    station.run_until(lambda: "Takeoff detected\t" in station.status_texts(), 4)
    assert 1.0 < station.now_s - armed_s < 2.5
    station.run_until(lambda: station.height_m > 0.2, 5)
    assert 3.0 < station.now_s - armed_s < 5.5, "PX4 lifts 2 to 5 s after the command"
    station.run_until(lambda: station.active_mode == HOLD_MODE, 20)
    station.run(4)
    assert station.height_m == pytest.approx(10, abs=1.2)
    assert station.newest_messages["EXTENDED_SYS_STATE"].landed_state == 2

    start = station.newest_messages["GLOBAL_POSITION_INT"]
    # Frame 6 means altitude above home, but PX4 uses the value as altitude above mean sea level.
    station.send(
        "COMMAND_INT", target_system=1, target_component=1, command=REPOSITION, frame=6, param1=-1, param2=1,
        param4=NAN, x=start.lat + round(20 / M_PER_DEG * 1e7), y=start.lon,
        z=(start.alt - start.relative_alt) / 1000 + 12.0,
    )  # fmt: skip
    station.run(18)
    assert station.acks(REPOSITION) == [0]
    reached = station.newest_messages["GLOBAL_POSITION_INT"]
    assert (reached.lat - start.lat) * 1e-7 * M_PER_DEG == pytest.approx(20, abs=2.0)
    assert reached.relative_alt / 1000 == pytest.approx(12, abs=1.0)

    station.command(LAND_COMMAND, 0, 0, 0, NAN, NAN, NAN, 0)
    station.run(0.2)
    assert station.active_mode == LAND_MODE
    station.run_until(lambda: "Landing detected\t" in station.status_texts(), 30)
    landed_s = station.now_s
    station.run_until(lambda: not station.armed, 4)
    assert station.now_s - landed_s == pytest.approx(2.0, abs=0.2)
    station.run(1.5)
    assert station.mode == HOLD_MODE
    assert station.status_texts()[-2:] == ["Landing detected\t", "Disarmed by landing\t"]


@pytest.mark.parametrize("armed_first", [True, False])
def test_a_take_off_reaches_its_altitude_in_both_orders_of_commands(armed_first: bool) -> None:
    station = Station()
    station.run_until(lambda: station.can_be_armed, 15)
    alt_home_m = 6.0
    alt_amsl_m = station.sim.autopilots[0].home.alt_amsl_m + alt_home_m
    takeoff = (TAKEOFF_COMMAND, -1, 0, 0, NAN, NAN, NAN, alt_amsl_m)
    for command in ((ARM, 1), takeoff) if armed_first else (takeoff, (ARM, 1)):
        station.command(int(command[0]), *command[1:])
        station.run(0.3)
    assert (station.acks(TAKEOFF_COMMAND), station.acks(ARM), station.active_mode) == ([0], [0], TAKEOFF_MODE)
    station.run_until(lambda: station.active_mode == HOLD_MODE, 20)
    station.run(2)
    assert station.height_m == pytest.approx(alt_home_m, abs=1.0)
    assert not any("default takeoff altitude" in text for text in station.status_texts())


def test_a_lost_offboard_stream_lands_v1_16_disarms_and_reports_offboard_again() -> None:
    station = Station(links=GCS_AND_API_LINKS, px4=V1_16)
    station.run_until(lambda: station.can_be_armed, 15)

    def send_setpoint() -> None:
        station.send(
            "SET_POSITION_TARGET_LOCAL_NED", via="api", target_system=1, target_component=1,
            coordinate_frame=1, type_mask=2552, z=-5.0, yaw=math.pi / 2,
        )  # fmt: skip

    station.run(1.1, send_setpoint)
    station.command(SET_MODE, 1, 6)
    station.run(0.2, send_setpoint)
    assert station.acks(SET_MODE) == [0, 0]
    station.command(ARM, 1)
    station.run(9, send_setpoint)
    assert station.armed
    assert station.active_mode == OFFBOARD_MODE
    assert station.newest_messages["LOCAL_POSITION_NED"].z == pytest.approx(-5, abs=0.5)
    assert station.newest_messages["ATTITUDE"].yaw == pytest.approx(math.pi / 2, abs=0.1)
    echo = station.newest_messages["POSITION_TARGET_LOCAL_NED"]
    assert (echo.x, echo.y, echo.z) == (0.0, 0.0, -5.0)

    lost_s = station.now_s
    station.run_until(lambda: station.active_mode == POSITION_MODE, 2)
    assert station.now_s - lost_s == pytest.approx(1.05, abs=0.1)
    assert "Failsafe activated\t" in station.status_texts()
    assert "commander_failsafe_enter_generic" in station.events(lost_s)
    station.run(3)
    assert station.newest_messages["HEARTBEAT"].system_status == 5
    assert station.newest_messages["CURRENT_MODE"].intended_custom_mode == OFFBOARD_MODE
    assert station.newest_messages["LOCAL_POSITION_NED"].vz == pytest.approx(0.6, abs=0.2)
    station.run_until(lambda: not station.armed, 15)
    station.run(1.2)
    assert station.height_m == pytest.approx(0.0, abs=0.05)
    assert station.mode == OFFBOARD_MODE


@pytest.mark.story
def test_a_vehicle_returns_to_offboard_when_the_stream_is_back() -> None:
    station = station_in_hover(Station, 6)

    def send_setpoint() -> None:
        station.send(
            "SET_POSITION_TARGET_LOCAL_NED", target_system=1, target_component=1, coordinate_frame=1,
            type_mask=3527, vx=0.0,
        )  # fmt: skip

    station.run(1.1, send_setpoint)
    station.command(SET_MODE, 1, 6)
    station.run(0.5, send_setpoint)
    station.run(2.0)
    assert station.active_mode == RTL_MODE
    station.run(0.3, send_setpoint)
    assert station.active_mode == OFFBOARD_MODE


@pytest.mark.parametrize(
    ("px4", "action", "mode"),
    [(V1_16, 1, ALTITUDE), (V1_17, 1, RTL_MODE), (V1_17, 3, RTL_MODE), (V1_17, 5, HOLD_MODE)],
    ids=lambda value: getattr(value, "name", None),
)
def test_a_lost_offboard_stream_triggers_the_action_of_its_parameter(
    px4: Px4Version, action: int, mode: int
) -> None:
    station = station_in_hover(Station, 4, {"COM_OBL_RC_ACT": action}, px4=px4)
    station.run(
        1.1, lambda: station.send("SET_POSITION_TARGET_LOCAL_NED", coordinate_frame=1, type_mask=2552, z=-4.0)
    )
    station.command(SET_MODE, 1, 6)
    station.run(
        0.2, lambda: station.send("SET_POSITION_TARGET_LOCAL_NED", coordinate_frame=1, type_mask=2552, z=-4.0)
    )
    assert station.active_mode == OFFBOARD_MODE
    station.run(1.3)
    assert station.active_mode == mode


@pytest.mark.story
def test_return_to_launch_climbs_flies_home_and_lands() -> None:
    station = station_in_hover(Station, 6, {"RTL_RETURN_ALT": 10.0}, sensor_noise=False)
    start = station.newest_messages["GLOBAL_POSITION_INT"]
    station.send(
        "COMMAND_INT", target_system=1, target_component=1, command=REPOSITION, frame=0, param1=-1, param2=1,
        param4=NAN, x=start.lat + round(12 / M_PER_DEG * 1e7), y=start.lon, z=NAN,
    )  # fmt: skip
    station.run(8)
    assert station.sim.simulation.truth.position_ned_m[0, 0] > 10.0
    station.command(RETURN)
    station.run_until(lambda: "RTL: land at destination\t" in station.status_texts(), 25)
    assert station.height_m == pytest.approx(10, abs=1.5)
    station.run_until(lambda: not station.armed, 45)
    north, east, _ = station.sim.simulation.truth.position_ned_m[0]
    assert math.hypot(north, east) < 1.5
    assert station.status_texts().count("Takeoff detected\t") == 1
    station.run(1.2)
    assert station.mode == HOLD_MODE


def test_a_vehicle_that_does_not_take_off_disarms_itself() -> None:
    station = Station()
    station.run_until(lambda: station.can_be_armed, 15)
    station.command(ARM, 1)
    station.run_until(lambda: not station.armed and bool(station.acks(ARM)), 13)
    assert station.status_texts()[-1] == "Disarmed by auto preflight disarming\t"


def test_a_vehicle_falls_after_kill_and_after_termination() -> None:
    station = station_in_hover(Station, 4)
    station.command(ARM, 0)
    station.run(0.1)
    assert station.acks(ARM)[-1] == 1
    assert station.status_texts()[-1] == "Disarming denied: not landed\t"
    station.command(ARM, 0, FORCE)
    station.run(0.1)
    assert not station.armed
    station.run(2)
    assert station.height_m < 0.1

    station = station_in_hover(Station, 4)
    station.command(TERMINATE, 1)
    station.run(2)
    assert station.active_mode == TERMINATION
    assert station.height_m < 0.5
    station.command(TERMINATE, 0)
    station.run(0.1)
    assert station.acks(TERMINATE) == [0, 2]


def test_a_lost_ground_station_triggers_a_return_after_the_delay() -> None:
    station = station_in_hover(Station, 4, {"NAV_DLL_ACT": 3, "COM_DL_LOSS_T": 3, "COM_FAIL_ACT_T": 2.0})
    station.heartbeats, lost_s = False, station.now_s
    station.run(5.7)  # 2.5 s of silence, then COM_DL_LOSS_T
    assert "commander_failsafe_enter_hold" in station.events(lost_s)
    assert station.active_mode == HOLD_MODE
    station.run(2.5)
    assert station.active_mode == LAND_MODE
    assert not station.status_texts(lost_s), "as recorded: without a ground station only events are sent"
    station.heartbeats = True
    station.run(0.2)
    assert station.status_texts(lost_s) == ["GCS connection regained\t"]


def test_a_critical_battery_returns_and_an_operator_may_take_over() -> None:
    station = station_in_hover(Station, 4, {"COM_FAIL_ACT_T": 1.0})
    station.sim.simulation.set_battery_remaining(0, 0.06)
    station.run(0.2)
    assert "commander_failsafe_enter_hold" in station.events()
    station.run(1.2)
    assert station.active_mode == RTL_MODE
    station.command(SET_MODE, 1, 4, 6)
    station.run(0.5)
    assert station.active_mode == LAND_MODE


def test_a_vehicle_without_a_position_cannot_be_armed_in_modes_that_need_a_position() -> None:
    station = Station()
    station.sim.simulation.set_gps_enabled(0, False)
    station.run(8)
    assert not station.can_be_armed
    station.command(ARM, 1, FORCE)
    station.run(0.2)
    assert station.acks(ARM) == [1]
    assert station.status_texts() == [
        "Preflight: GPS fix too low", "Arming denied: Resolve system health failures first\t",
    ]  # fmt: skip
    assert {"check_modes_local_pos", "check_modes_global_pos"} <= set(station.events())


def test_autotuning_is_accepted_on_the_ground_and_refused_in_flight() -> None:
    station = Station()
    station.run_until(lambda: station.can_be_armed, 15)
    station.run(1.0)
    since_s = station.now_s
    station.command(AUTOTUNE, 1)
    station.run(0.1)
    assert station.acks(AUTOTUNE) == [5], "in progress, as recorded"
    assert [m.param_id for m in station.received("PARAM_VALUE", since_s=since_s)] == ["MC_AT_START"]
    station.command(ARM, 1)
    station.run(0.1)
    station.command(AUTOTUNE, 1)
    station.run(0.1)
    assert station.acks(AUTOTUNE) == [5, 3]
    assert "Autotuning is not simulated" in station.status_texts()
