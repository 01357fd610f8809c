"""What a simulated PX4 v1.17 does differently from v1.16."""

from __future__ import annotations

import json
import lzma
import math

import pytest

from tests.unit.vehicle_sim.sim_station import (
    ARM_DISARM,
    DO_SET_MODE,
    HOLD_MODE,
    NAN,
    OFFBOARD_MODE,
    POSITION_MODE,
    RTL_MODE,
    TAKEOFF_COMMAND,
    Station,
)
from vehicle_sim.autopilot.failsafe import Action
from vehicle_sim.autopilot.failsafe_actions import Conditions, flight_actions
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.mavlink.dialect import BY_NAME
from vehicle_sim.mavlink.services import stored_items
from vehicle_sim.parameters import Parameters
from vehicle_sim.px4_version import V1_16, V1_17, Px4Version
from vehicle_sim.storage import metadata

ALTITUDE_CRUISE_MODE = 0xB0000
REQUEST_MESSAGE, SET_MESSAGE_INTERVAL, GET_MESSAGE_INTERVAL, DO_SET_HOME = 512, 511, 510, 179
POSITION_MASK = 2552
BOTH = pytest.mark.parametrize("px4", [V1_16, V1_17], ids=["1.16", "1.17"])


def station_of(px4: Px4Version, **options) -> Station:
    """A vehicle that is ready to arm."""
    station = Station(px4=px4, **({"sensor_noise": False} | options))
    station.run(6.0)
    return station


def in_hold(px4: Px4Version, **options) -> Station:
    """A vehicle in Hold at 10 m."""
    station = station_of(px4, **options)
    station.command(ARM_DISARM, 1)
    home = station.sim.autopilots[0].home
    station.command(TAKEOFF_COMMAND, NAN, 0, 0, NAN, NAN, NAN, home.alt_amsl_m + 10.0)
    station.run(2.0)
    station.run_until(lambda: station.active_mode == HOLD_MODE, 40)
    return station


def test_parameters_that_came_went_or_changed_default():
    old, new = Parameters(px4=V1_16), Parameters(px4=V1_17)
    assert (len(old), len(new)) == (929, 913)
    assert [name in store for name in ("MPC_HOLD_DZ", "MAN_DEADZONE") for store in (old, new)] == [
        True, False, False, True,
    ]  # fmt: skip
    assert (old.get("MC_ROLL_P"), new.get("MC_ROLL_P")) == (6.5, 4.0)
    assert (old.index_of("SYS_AUTOSTART"), new.index_of("SYS_AUTOSTART")) == (896, 878)


@BOTH
def test_the_metadata_describe_the_parameters_and_events_of_the_version(px4):
    files = metadata.built_in(px4)
    parameters = json.loads(lzma.decompress(files[metadata.PARAMETERS]()))["parameters"]
    assert [each["name"] for each in parameters] == list(Parameters(px4=px4).names)
    events = json.loads(lzma.decompress(files[metadata.EVENTS]()))["components"]["1"]
    names = {e["name"] for group in events["event_groups"].values() for e in group["events"].values()}
    assert ("check_rc_dz_too_high" in names) == (px4 is V1_16)
    assert ("24" in events["enums"]["navigation_mode_t"]["entries"]) == (px4 is V1_17)


@BOTH
def test_altitude_cruise_is_entered_disarmed_and_refused_in_flight_without_sticks(px4):
    station = in_hold(px4)
    begin_s = station.now_s
    station.command(DO_SET_MODE, 1, 11, 0)
    station.run(0.5)
    assert station.received("COMMAND_ACK", since_s=begin_s)[-1].result == (0 if px4 is V1_16 else 1)
    assert station.active_mode == HOLD_MODE
    ground = station_of(px4)
    ground.command(DO_SET_MODE, 1, 11, 0)
    ground.run(1.5)
    assert ground.active_mode == (HOLD_MODE if px4 is V1_16 else ALTITUDE_CRUISE_MODE)


@BOTH
def test_a_lost_stream_without_sticks_ends_in_position_or_returns(px4):
    station = in_hold(px4)

    def stream() -> None:
        station.send(
            "SET_POSITION_TARGET_LOCAL_NED", target_system=1, target_component=1,
            coordinate_frame=1, type_mask=POSITION_MASK, z=-10.0,
        )  # fmt: skip

    station.run(0.5, stream)
    station.command(DO_SET_MODE, 1, 6)
    station.run(1.0, stream)
    assert station.active_mode == OFFBOARD_MODE
    station.run(3.0)
    assert station.active_mode == (POSITION_MODE if px4 is V1_16 else RTL_MODE)


def test_the_action_for_lost_sticks_replaces_a_mode_that_needs_them():
    lost = Conditions(NavState.OFFBOARD, offboard_lost=True, manual_loss_action=3)
    (fallback,) = flight_actions(lost)
    assert fallback.action is Action.FALLBACK_POSITION
    (fallback,) = flight_actions(lost._replace(fallback_needs_sticks=True))
    assert fallback.action is Action.LAND
    (fallback,) = flight_actions(lost._replace(fallback_needs_sticks=True, sticks=True))
    assert fallback.action is Action.FALLBACK_POSITION


@pytest.mark.parametrize(("mode", "bit"), [(NavState.EXTERNAL1, 8), (NavState.ALTITUDE_CRUISE, 16)])
def test_lost_sticks_may_be_ignored_in_external_modes_and_altitude_cruise(mode, bit):
    lost = Conditions(mode, manual_lost=True, manual_loss_action=2, fallback_needs_sticks=True)
    assert [each.action for each in flight_actions(lost)] == [Action.RTL]
    assert flight_actions(lost._replace(manual_loss_except=bit)) == []


@pytest.mark.parametrize("px4", [V1_17, pytest.param(V1_16, marks=pytest.mark.story)], ids=["1.17", "1.16"])
def test_the_altitude_of_home_moves_for_two_minutes_after_a_take_off(px4):
    station = in_hold(px4, sensor_noise=True)
    home = station.sim.autopilots[0].home
    altitudes_m, global_m = set(), home.alt_amsl_m + home.position_ned_m[2]
    for _ in range(60):
        station.run(1.0)
        altitudes_m.add(home.alt_amsl_m)
    assert (len(altitudes_m) > 10) == (px4 is V1_17)
    assert max(altitudes_m) - min(altitudes_m) < 6.0
    assert home.alt_amsl_m + home.position_ned_m[2] == pytest.approx(global_m, abs=1e-3)
    station.run(60.0)
    set_at_us = home.set_at_us
    station.run(10.0)
    assert home.set_at_us == set_at_us


@BOTH
def test_home_has_roll_and_pitch(px4):
    station = station_of(px4)
    home = station.sim.autopilots[0].home
    station.command(DO_SET_HOME, 0, 10, -20, 30, home.lat_deg, home.lon_deg, home.alt_amsl_m)
    station.run(2.5)
    w, x, y, z = station.newest_messages["HOME_POSITION"].q
    yaw_deg = math.degrees(math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
    roll_deg = math.degrees(math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)))
    assert (roll_deg, yaw_deg) == pytest.approx((10.0 if px4 is V1_17 else 0.0, 30.0), abs=1e-4)


@BOTH
def test_the_integrity_of_gnss_is_streamed(px4):
    station = station_of(px4)
    begin_s = station.now_s
    station.run(5.0)
    count = len(station.received("GNSS_INTEGRITY", since_s=begin_s))
    assert count == 0 if px4 is V1_16 else count in (5, 6)
    station.command(SET_MESSAGE_INTERVAL, BY_NAME["GNSS_INTEGRITY"].id, 100_000)
    station.run(0.2)
    assert station.newest_messages["COMMAND_ACK"].result == (4 if px4 is V1_16 else 0)


@BOTH
def test_the_interval_of_a_message_that_is_not_streamed(px4):
    station = station_of(px4)
    station.command(GET_MESSAGE_INTERVAL, 410)
    station.run(0.2)
    assert station.newest_messages["MESSAGE_INTERVAL"].interval_us == (0 if px4 is V1_16 else -1)
    station.command(REQUEST_MESSAGE, BY_NAME["MESSAGE_INTERVAL"].id, 0)
    station.run(0.2)
    assert station.newest_messages["COMMAND_ACK"].result == (2 if px4 is V1_16 else 0)


@BOTH
def test_the_state_of_the_mission_is_reported(px4):
    station = station_of(px4)
    mission = station.newest_messages["MISSION_CURRENT"]
    assert (mission.mission_state, mission.mission_mode) == ((0, 0) if px4 is V1_16 else (1, 2))
    arming = {
        "frame": 2, "command": 400, "autocontinue": 1, "x": 0, "y": 0, "z": 0.0,
        **{f"param{n}": 0.0 for n in range(1, 5)},
    }  # fmt: skip
    result, _ = stored_items.store(stored_items.MISSION, arming, as_int=True, px4=px4)
    assert result == (stored_items.UNSUPPORTED if px4 is V1_16 else stored_items.ACCEPTED)


def test_sticks_have_the_dead_zone_and_the_expo_of_v1_17():
    station = station_of(V1_17)
    for forward, expected in (
        (95, 0.0),
        (550, 0.275),
    ):
        station.send("MANUAL_CONTROL", target=1, x=forward, y=0, z=500, r=0)
        station.run(0.1)
        assert station.sim.autopilots[0].sticks.shaped().forward == pytest.approx(expected)


def test_the_console_names_the_version():
    station = station_of(V1_17)
    station.send("SERIAL_CONTROL", device=10, flags=6, count=8, data=list(b"ver git\n".ljust(70, b"\0")))
    station.run(0.5)
    text = b"".join(bytes(m.data[: m.count]) for m in station.received("SERIAL_CONTROL")).decode()
    assert "Release 1.17.0 (17891583)" in text
