"""Steady ticks and skipped checks give the same results as full ticks and checks, bit for bit and at the
same time."""

import hashlib
import math
from collections.abc import Callable, Mapping

import numpy as np
import pytest

from vehicle_sim.autopilot.autopilot import Autopilot
from vehicle_sim.autopilot.failsafe_watch import CheckSkipper
from vehicle_sim.autopilot.mission.items import POSITION_ITEMS, Item
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.autopilot.offboard import trajectory_setpoint
from vehicle_sim.autopilot.plans import MISSION
from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.geodesy import to_global
from vehicle_sim.px4_version import V1_16, V1_17, Px4Version
from vehicle_sim.sensors.suite import Driver

pytestmark = pytest.mark.flight

RELATIVE, NO_FRAME = 6, 2
WAYPOINT, LAND, TAKEOFF, DELAY, CHANGE_SPEED, ROI_LOCATION, ROI_NONE = 16, 21, 22, 93, 178, 195, 197
Script = Mapping[float, Callable[[SimulatedFleet], object]]
"""Actions by time since boot [s]."""


def mission_item(command: int, north_m: float, east_m: float, alt_home_m: float, *parameters: float) -> Item:
    home = SimulatedFleet(links=()).simulation.origin
    lat, lon = to_global(*(np.array(value) for value in (north_m, east_m, home.lat_deg, home.lon_deg)))
    all_parameters = (*parameters, 0.0, 0.0, 0.0, 0.0)[:4]
    frame = RELATIVE if command in POSITION_ITEMS | {ROI_LOCATION} else NO_FRAME
    return Item(frame, command, True, all_parameters, float(lat), float(lon), alt_home_m)


def fly(
    script: Script, seconds: float, count: int = 1, px4: Px4Version = V1_16
) -> tuple[str, list[str], float]:
    """Digest of all motions, setpoints and gimbals; messages; and the fraction of ticks that were steady."""
    sim = SimulatedFleet(count, links=(), seed=3, px4=px4)
    for row in range(count):
        sim.simulation.set_wind(np.array([2.0 * row, 3.0, 0.0]), row)
        sim.simulation.set_gusts(0.5, row)
    messages: list[str] = []
    for autopilot in sim.autopilots:
        autopilot.announcer.add_listener(lambda message: messages.append(f"{sim.time_s:.3f} {message}"))
    digest, steady_count, pending_actions = hashlib.sha256(), 0, sorted(script.items())
    for _ in range(round(seconds / 0.02)):
        while pending_actions and pending_actions[0][0] <= sim.time_s:
            pending_actions.pop(0)[1](sim)
        sim.step(0.02)
        truth, setpoints = sim.simulation.truth, sim.simulation.setpoints
        for values in (
            truth.position_ned_m, truth.q_ned_frd, setpoints.position_ned_m, setpoints.velocity_ned_m_s,
            setpoints.acceleration_ned_m_s2, setpoints.yaw_ned_rad, setpoints.yaw_rate_ned_rad_s,
            setpoints.tilt_limit_rad, setpoints.landed, setpoints.in_air, setpoints.level,
        ):  # fmt: skip
            digest.update(values.tobytes())
        for autopilot in sim.autopilots:
            digest.update(repr((autopilot.gimbal.actual, autopilot.gimbal.rates)).encode())
        steady_count += sum(not autopilot.ran_full_tick for autopilot in sim.autopilots)
    return digest.hexdigest(), messages, steady_count / (count * seconds / 0.02)


def disable_steady_ticks(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_task(_autopilot: Autopilot) -> None: ...

    monkeypatch.setattr(Autopilot, "_steady_task", no_task)


def compare_ticks(
    script: Script,
    seconds: float,
    monkeypatch: pytest.MonkeyPatch,
    count: int = 1,
    px4: Px4Version = V1_16,
) -> float:
    """Flies with and without steady ticks and compares the results; returns the fraction of steady ticks."""
    digest, messages, steady_fraction = fly(script, seconds, count, px4)
    with monkeypatch.context() as patch:
        disable_steady_ticks(patch)
        full_digest, full_messages, fraction_if_disabled = fly(script, seconds, count, px4)
    assert fraction_if_disabled == 0.0
    assert messages == full_messages
    assert digest == full_digest
    return steady_fraction


def for_each_autopilot(action: Callable[[Autopilot], object]) -> Callable[[SimulatedFleet], object]:
    return lambda sim: [action(autopilot) for autopilot in sim.autopilots]


def start_mission(sim: SimulatedFleet) -> None:
    items = [
        mission_item(TAKEOFF, 0.0, 0.0, 6.0, 0.0, 0.0, 0.0, math.nan),
        mission_item(WAYPOINT, 12.0, 0.0, 6.0, 1.5, 0.0, 0.0, math.nan),
        mission_item(CHANGE_SPEED, 0.0, 0.0, 0.0, 1.0, 8.0, -1.0),
        mission_item(ROI_LOCATION, 30.0, 30.0, 0.0),
        mission_item(WAYPOINT, 12.0, 15.0, 8.0, 0.0, 0.0, 0.0, math.nan),
        mission_item(ROI_NONE, 0.0, 0.0, 0.0),
        mission_item(DELAY, 0.0, 0.0, 0.0, 1.0),
        mission_item(LAND, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, math.nan),
    ]
    for autopilot in sim.autopilots:
        autopilot.plans.store(MISSION, items)
        assert autopilot.commander.start_mission(0.0)


@pytest.mark.story
def test_a_mission_is_flown_identically_with_steady_and_full_ticks(monkeypatch: pytest.MonkeyPatch) -> None:
    steady_fraction = compare_ticks({5.0: start_mission}, 55.0, monkeypatch, count=2, px4=V1_17)
    assert steady_fraction > 0.6


def take_off(autopilot: Autopilot) -> None:
    autopilot.navigator.request_takeoff(autopilot.view.estimate.alt_amsl_m + 9.0)
    assert autopilot.commander.set_mode(NavState.TAKEOFF)
    assert autopilot.commander.arm()


def test_commands_parameters_and_failures_act_at_once_in_a_steady_flight(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    script: Script = {
        5.0: for_each_autopilot(take_off),
        13.0: lambda sim: sim.set_parameter(0, "MPC_Z_V_AUTO_UP", 1.0),
        14.0: for_each_autopilot(lambda autopilot: autopilot.gimbal.set_pitch_yaw(0, -0.5, 0.7)),
        14.5: for_each_autopilot(
            lambda autopilot: autopilot.gimbal.set_pitch_yaw(0, math.nan, math.nan, 0.4)
        ),
        14.8: for_each_autopilot(lambda autopilot: autopilot.gimbal.point_at(47.4, 8.5, 490.0)),
        15.03: for_each_autopilot(lambda autopilot: autopilot.commander.set_mode(NavState.LAND)),
        15.2: for_each_autopilot(lambda autopilot: autopilot.gimbal.centre()),
        17.55: for_each_autopilot(lambda autopilot: autopilot.commander.set_mode(NavState.HOLD)),
        19.0: for_each_autopilot(lambda autopilot: autopilot.commander.set_mode(NavState.LAND)),
        21.0: for_each_autopilot(lambda autopilot: autopilot.navigator.change_speed(3.0, 0.5)),
        22.0: lambda sim: sim.simulation.set_gps_enabled(0, False),
    }
    steady_fraction = compare_ticks(script, 32.0, monkeypatch)
    assert steady_fraction > 0.4


def test_spool_up_take_off_ramp_and_ground_contact_use_steady_ticks(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The other ticks are full: before arming, after disarming, and while the vehicle brakes for the
    landing."""

    def set_fast_landing(sim: SimulatedFleet) -> None:
        for name, value in {"MPC_LAND_SPEED": 2.0, "MPC_LAND_CRWL": 1.5}.items():
            sim.set_parameter(0, name, value)

    script: Script = {
        0.5: set_fast_landing,
        1.0: for_each_autopilot(take_off),
        6.5: for_each_autopilot(lambda autopilot: autopilot.commander.set_mode(NavState.LAND)),
    }
    sims: list[SimulatedFleet] = []
    script[6.6] = sims.append
    steady_fraction = compare_ticks(script, 16.5, monkeypatch)
    assert not any(sim.autopilots[0].commander.armed for sim in sims)
    assert steady_fraction > 0.8


def test_a_forced_disarm_in_a_steady_flight_stops_the_motors_in_the_same_tick() -> None:
    sim = SimulatedFleet(links=(), seed=3)
    autopilot = sim.autopilots[0]
    sim.step(5.0)
    take_off(autopilot)
    while not autopilot.steady and sim.time_s < 20.0:
        sim.step(0.02)
    sim.step(0.1)
    assert autopilot.steady
    autopilot.commander.disarm(force=True)
    sim.step(0.02)
    assert not autopilot.steady
    assert autopilot.ran_full_tick
    assert not sim.simulation.setpoints.armed[0]


def stream_script(end_s: float) -> Script:
    """A take-off, then a stream of each kind of trajectory setpoints at 50 Hz, and attitudes between them."""
    nan3 = (math.nan, math.nan, math.nan)

    def send(autopilot: Autopilot) -> None:
        t = autopilot.view.time_s - 15.0
        offboard = autopilot.offboard
        position = (8.0 * math.sin(0.5 * t), 8.0 - 8.0 * math.cos(0.5 * t), -9.0)
        velocity = (4.0 * math.cos(0.5 * t), 4.0 * math.sin(0.5 * t), 0.0)
        if t < 6.0:
            offboard.trajectory(trajectory_setpoint(position, velocity, nan3, 0.3 * t, math.nan))
        elif t < 9.0:
            offboard.trajectory(trajectory_setpoint(nan3, (1.0, 2.0, -0.2), nan3, math.nan, 0.1))
        elif t < 9.5:
            offboard.attitude(7, (0.99, 0.1, 0.0, 0.0), (0.0, 0.0, 0.0), 0.5)
        elif t < 12.0:
            offboard.trajectory(trajectory_setpoint((3.0, 3.0, -9.0), nan3, nan3, math.nan, math.nan))
        elif t < 13.0:
            offboard.trajectory(trajectory_setpoint((3.0, math.nan, -9.0), nan3, nan3, 1.0, math.nan))
        elif t < 14.0:
            offboard.trajectory(trajectory_setpoint(nan3, nan3, nan3, 1.0, math.nan))
        elif t < 18.0:
            offboard.trajectory(trajectory_setpoint((-5.0, 0.0, -7.0), nan3, nan3, 1.0, math.nan))

    script: dict[float, Callable[[SimulatedFleet], object]] = {5.0: for_each_autopilot(take_off)}
    script |= {15.0 + k * 0.02: for_each_autopilot(send) for k in range(round((end_s - 15.0) / 0.02))}
    script[15.5] = for_each_autopilot(lambda autopilot: autopilot.commander.set_mode(NavState.OFFBOARD))
    script[25.21] = lambda sim: sim.set_parameter(0, "MPC_XY_P", 0.8)
    return script


@pytest.mark.story
def test_setpoints_are_flown_identically_with_steady_and_full_ticks_until_the_stream_is_lost(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    steady_fraction = compare_ticks(stream_script(36.0), 38.0, monkeypatch, count=2)
    assert steady_fraction > 0.5


def climb_60_m(autopilot: Autopilot) -> None:
    autopilot.navigator.request_takeoff(autopilot.view.estimate.alt_amsl_m + 60.0)
    assert autopilot.commander.set_mode(NavState.TAKEOFF)
    assert autopilot.commander.arm()


FAILURES: Script = {
    8.6: lambda sim: setattr(sim.autopilots[0].commander.checks, "gcs_heartbeat_at_s", sim.time_s),
    12.0: lambda sim: sim.set_parameter(1, "GF_ACTION", 1),
    14.0: lambda sim: sim.set_parameter(1, "GF_MAX_VER_DIST", 12.0),
    14.1: lambda sim: sim.simulation.set_driver(2, Driver.MAG, False),
    14.2: lambda sim: sim.simulation.set_battery_remaining(3, 0.14),
    14.3: lambda sim: sim.simulation.set_gps_enabled(4, False),
    15.2: lambda sim: sim.simulation.set_driver(2, Driver.MAG, True),
    15.5: lambda sim: sim.simulation.set_battery_remaining(3, 0.05),
    19.5: lambda sim: sim.simulation.set_gps_enabled(4, True),
}
"""A lost ground station, a geofence breach, a magnetometer without data, an empty battery and a lost GNSS;
each affects one vehicle."""
FAILURE_MESSAGES = (
    "commander_gcs_lost", "exceeding maximum altitude", "MAG #0 failed", "commander_failsafe_enter_low_bat",
    "commander_failsafe_enter_hold", "commander_failsafe_enter_autopilot_disengaged",
)  # fmt: skip


def test_checks_are_skipped_only_while_their_results_do_not_change(monkeypatch: pytest.MonkeyPatch) -> None:
    skipped: list[bool] = []
    skip_if_unchanged = CheckSkipper.skip_if_unchanged

    def skip_and_record(skipper: CheckSkipper, armed_at_s: float) -> bool:
        skipped.append(skip_if_unchanged(skipper, armed_at_s))
        return skipped[-1]

    def never_skip(_skipper: CheckSkipper, _armed_at_s: float) -> bool:
        return False

    script: Script = {5.0: for_each_autopilot(climb_60_m), **FAILURES}
    with monkeypatch.context() as patch:
        patch.setattr(CheckSkipper, "skip_if_unchanged", skip_and_record)
        result = fly(script, 22.0, count=5)
    monkeypatch.setattr(CheckSkipper, "skip_if_unchanged", never_skip)
    assert fly(script, 22.0, count=5) == result
    missing = [text for text in FAILURE_MESSAGES if not any(text in message for message in result[1])]
    assert not missing
    assert sum(skipped) > 100
