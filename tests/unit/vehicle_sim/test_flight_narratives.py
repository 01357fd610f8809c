"""Whole flights by MAVLink messages, on simulated time."""

import math

import pytest

from tests.unit.vehicle_sim.prepared_stations import hovering
from tests.unit.vehicle_sim.sim_station import (
    BOTH,
    HOLD,
    LAND,
    NAN,
    OFFBOARD,
    POSITION,
    RTL,
    TAKEOFF,
    Station,
)

pytestmark = pytest.mark.flight


def test_a_flight_from_boot_to_landing() -> None:
    s = Station()
    assert s.run_until(lambda: s.ready, 10) < 10

    armed_at = s.now_s
    s.command(400, 1)
    s.run(0.1)
    assert s.armed
    assert s.acks(400) == [0]
    assert s.texts() == ["Armed by external command\t"]
    assert "commander_armed_by" in s.events()

    s.command(22, -1, 0, 0, NAN, NAN, NAN, s.sim.autopilots[0].home.alt_amsl_m + 10)
    s.run(0.1)
    assert s.acks(22) == [0]
    assert s.active_mode == TAKEOFF
    s.run_until(lambda: "Takeoff detected\t" in s.texts(), 4)
    assert 1.0 < s.now_s - armed_at < 2.5
    s.run_until(lambda: s.height_m > 0.2, 5)
    assert 3.0 < s.now_s - armed_at < 5.5, "PX4 lifts 2 to 5 s after the command"
    s.run_until(lambda: s.active_mode == HOLD, 20)
    s.run(4)
    assert s.height_m == pytest.approx(10, abs=1.2)
    assert s.last["EXTENDED_SYS_STATE"].landed_state == 2

    here = s.last["GLOBAL_POSITION_INT"]
    # The frame says height above home, but PX4 uses the value as altitude above mean sea level.
    s.send(
        "COMMAND_INT", target_system=1, target_component=1, command=192, frame=6, param1=-1, param2=1,
        param4=NAN, x=here.lat + round(20 / 111195 * 1e7), y=here.lon,
        z=(here.alt - here.relative_alt) / 1000 + 12.0,
    )  # fmt: skip
    s.run(18)
    assert s.acks(192) == [0]
    there = s.last["GLOBAL_POSITION_INT"]
    assert (there.lat - here.lat) * 1e-7 * 111195 == pytest.approx(20, abs=2.0)
    assert there.relative_alt / 1000 == pytest.approx(12, abs=1.0)

    s.command(21, 0, 0, 0, NAN, NAN, NAN, 0)
    s.run(0.2)
    assert s.active_mode == LAND
    s.run_until(lambda: "Landing detected\t" in s.texts(), 30)
    landed_at = s.now_s
    s.run_until(lambda: not s.armed, 4)
    assert s.now_s - landed_at == pytest.approx(2.0, abs=0.2)
    s.run(1.5)
    assert s.mode == HOLD
    assert s.texts()[-2:] == ["Landing detected\t", "Disarmed by landing\t"]


@pytest.mark.parametrize("armed_first", [True, False])
def test_a_take_off_reaches_its_altitude_in_both_orders_of_commands(armed_first: bool) -> None:
    s = Station()
    s.run_until(lambda: s.ready, 15)
    wanted_m = 6.0
    takeoff = (22, -1, 0, 0, NAN, NAN, NAN, s.sim.autopilots[0].home.alt_amsl_m + wanted_m)
    for command in ((400, 1), takeoff) if armed_first else (takeoff, (400, 1)):
        s.command(int(command[0]), *command[1:])
        s.run(0.3)
    assert (s.acks(22), s.acks(400), s.active_mode) == ([0], [0], TAKEOFF)
    s.run_until(lambda: s.active_mode == HOLD, 20)
    s.run(2)
    assert s.height_m == pytest.approx(wanted_m, abs=1.0)
    assert not any("default takeoff altitude" in text for text in s.texts())


def test_a_lost_offboard_stream_lands_disarms_and_reports_offboard_again() -> None:
    s = Station(links=BOTH)
    s.run_until(lambda: s.ready, 15)

    def stream() -> None:
        s.send(
            "SET_POSITION_TARGET_LOCAL_NED", via="api", target_system=1, target_component=1,
            coordinate_frame=1, type_mask=2552, z=-5.0, yaw=math.pi / 2,
        )  # fmt: skip

    s.run(1.1, stream)
    s.command(176, 1, 6)
    s.run(0.2, stream)
    assert s.acks(176) == [0, 0]
    s.command(400, 1)
    s.run(9, stream)
    assert s.armed
    assert s.active_mode == OFFBOARD
    assert s.last["LOCAL_POSITION_NED"].z == pytest.approx(-5, abs=0.5)
    assert s.last["ATTITUDE"].yaw == pytest.approx(math.pi / 2, abs=0.1)
    echo = s.last["POSITION_TARGET_LOCAL_NED"]
    assert (echo.x, echo.y, echo.z) == (0.0, 0.0, -5.0)

    lost_at = s.now_s
    s.run_until(lambda: s.active_mode == POSITION, 2)
    assert s.now_s - lost_at == pytest.approx(1.05, abs=0.1)
    assert "Failsafe activated\t" in s.texts()
    assert "commander_failsafe_enter_generic" in s.events(lost_at)
    s.run(3)
    assert s.last["HEARTBEAT"].system_status == 5
    assert s.last["CURRENT_MODE"].intended_custom_mode == OFFBOARD
    assert s.last["LOCAL_POSITION_NED"].vz == pytest.approx(0.6, abs=0.2)
    s.run_until(lambda: not s.armed, 15)
    s.run(1.2)
    assert s.height_m == pytest.approx(0.0, abs=0.05)
    assert s.mode == OFFBOARD


@pytest.mark.story
def test_a_recovered_stream_is_flown_again() -> None:
    s = hovering(Station, 6)

    def stream() -> None:
        s.send(
            "SET_POSITION_TARGET_LOCAL_NED", target_system=1, target_component=1, coordinate_frame=1,
            type_mask=3527, vx=0.0,
        )  # fmt: skip

    s.run(1.1, stream)
    s.command(176, 1, 6)
    s.run(0.5, stream)
    s.run(2.0)
    assert s.active_mode == POSITION
    s.run(0.3, stream)
    assert s.active_mode == OFFBOARD


@pytest.mark.parametrize(("action", "mode"), [(1, 0x20000), (3, RTL), (5, HOLD)])
def test_a_lost_offboard_stream_triggers_the_action_of_its_parameter(action: int, mode: int) -> None:
    s = hovering(Station, 4, {"COM_OBL_RC_ACT": action})
    s.run(1.1, lambda: s.send("SET_POSITION_TARGET_LOCAL_NED", coordinate_frame=1, type_mask=2552, z=-4.0))
    s.command(176, 1, 6)
    s.run(0.2, lambda: s.send("SET_POSITION_TARGET_LOCAL_NED", coordinate_frame=1, type_mask=2552, z=-4.0))
    assert s.active_mode == OFFBOARD
    s.run(1.3)
    assert s.active_mode == mode


@pytest.mark.story
def test_return_to_launch_climbs_flies_home_and_lands() -> None:
    s = hovering(Station, 6, {"RTL_RETURN_ALT": 10.0})
    here = s.last["GLOBAL_POSITION_INT"]
    s.send(
        "COMMAND_INT", target_system=1, target_component=1, command=192, frame=0, param1=-1, param2=1,
        param4=NAN, x=here.lat + round(12 / 111195 * 1e7), y=here.lon, z=NAN,
    )  # fmt: skip
    s.run(8)
    assert s.sim.simulation.truth.position_ned_m[0, 0] > 10.0
    s.command(20)
    s.run_until(lambda: "RTL: land at destination\t" in s.texts(), 25)
    assert s.height_m == pytest.approx(10, abs=1.5)
    s.run_until(lambda: not s.armed, 45)
    north, east, _ = s.sim.simulation.truth.position_ned_m[0]
    assert math.hypot(north, east) < 1.5
    assert s.texts().count("Takeoff detected\t") == 1
    s.run(1.2)
    assert s.mode == HOLD


def test_without_a_take_off_the_vehicle_disarms_itself() -> None:
    s = Station()
    s.run_until(lambda: s.ready, 15)
    s.command(400, 1)
    s.run_until(lambda: not s.armed and bool(s.acks(400)), 13)
    assert s.texts()[-1] == "Disarmed by auto preflight disarming\t"


def test_after_kill_and_termination_the_vehicle_falls() -> None:
    s = hovering(Station, 4)
    s.command(400, 0)
    s.run(0.1)
    assert s.acks(400)[-1] == 1
    assert s.texts()[-1] == "Disarming denied: not landed\t"
    s.command(400, 0, 21196)
    s.run(0.1)
    assert not s.armed
    s.run(2)
    assert s.height_m < 0.1

    s = hovering(Station, 4)
    s.command(185, 1)
    s.run(2)
    assert s.active_mode == 0x0A0000
    assert s.height_m < 0.5
    s.command(185, 0)
    s.run(0.1)
    assert s.acks(185) == [0, 2]


def test_a_lost_ground_station_triggers_a_return_after_the_delay() -> None:
    s = hovering(Station, 4, {"NAV_DLL_ACT": 3, "COM_DL_LOSS_T": 3, "COM_FAIL_ACT_T": 2.0})
    s.heartbeats, lost_s = False, s.now_s
    s.run(5.7)  # 2.5 s of silence, then COM_DL_LOSS_T
    assert "commander_failsafe_enter_hold" in s.events(lost_s)
    assert s.active_mode == HOLD
    s.run(2.5)
    assert s.active_mode == LAND
    assert not s.texts(lost_s), "as recorded: without a ground station only events are sent"
    s.heartbeats = True
    s.run(0.2)
    assert s.texts(lost_s) == ["GCS connection regained\t"]


def test_a_critical_battery_returns_and_an_operator_may_take_over() -> None:
    s = hovering(Station, 4, {"COM_FAIL_ACT_T": 1.0})
    s.sim.simulation.set_battery_remaining(0, 0.06)
    s.run(0.2)
    assert "commander_failsafe_enter_hold" in s.events()
    s.run(1.2)
    assert s.active_mode == RTL
    s.command(176, 1, 4, 6)
    s.run(0.5)
    assert s.active_mode == LAND


def test_without_a_position_modes_that_need_one_cannot_be_armed() -> None:
    s = Station()
    s.sim.simulation.set_gps_enabled(0, False)
    s.run(8)
    assert not s.ready
    s.command(400, 1, 21196)
    s.run(0.2)
    assert s.acks(400) == [1]
    assert s.texts() == [
        "Preflight: GPS fix too low", "Arming denied: Resolve system health failures first\t",
    ]  # fmt: skip
    assert {"check_modes_local_pos", "check_modes_global_pos"} <= set(s.events())


def test_autotuning_is_accepted_on_the_ground_and_refused_in_flight() -> None:
    station = Station()
    station.run_until(lambda: station.ready, 15)
    station.run(1.0)
    since_s = station.now_s
    station.command(212, 1)
    station.run(0.1)
    assert station.acks(212) == [5], "in progress, as recorded"
    assert [m.param_id for m in station.received("PARAM_VALUE", since_s=since_s)] == ["MC_AT_START"]
    station.command(400, 1)
    station.run(0.1)
    station.command(212, 1)
    station.run(0.1)
    assert station.acks(212) == [5, 3]
    assert "Autotuning is not simulated" in station.texts()
