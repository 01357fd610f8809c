"""Failsafes: the state machine alone, and whole flights with a failsafe."""

import math

import pytest

from tests.unit.vehicle_sim.plan_station import TERMINATION_MODE, PlanStation
from tests.unit.vehicle_sim.prepared_stations import station_in_hover
from tests.unit.vehicle_sim.sim_station import EVENT_NAMES, HOLD_MODE, LAND_MODE, RTL_MODE
from vehicle_sim.autopilot import health
from vehicle_sim.autopilot.failsafe import (
    Action,
    ActionOptions,
    Cause,
    ClearCondition,
    Decision,
    Failsafe,
    UserTakeover,
)
from vehicle_sim.autopilot.failsafe_actions import Conditions, flight_actions
from vehicle_sim.autopilot.modes import NavState

pytestmark = pytest.mark.flight

ARM, INJECT_FAILURE = 400, 420
LOST_GCS = ActionOptions("gcs", Action.RTL, Cause.GCS_LOSS, ClearCondition.ON_MODE_CHANGE)
LOW_BATTERY = ActionOptions("battery", Action.WARN, Cause.BATTERY_LOW)
EMPTY_BATTERY = ActionOptions("battery", Action.LAND, Cause.BATTERY_EMERGENCY)


class FailsafeMachine:
    """A failsafe state machine with a fake clock."""

    def __init__(self) -> None:
        self.failsafe, self.now_s, self.intended = Failsafe(), 0.0, NavState.HOLD
        self.runnable: frozenset[NavState] | None = None

    def update_after(self, seconds: float, *active: ActionOptions) -> Decision:
        self.now_s += seconds
        return self.failsafe.update(
            self.now_s, active, intended=self.intended, delay_s=5.0,
            can_run=lambda mode: self.runnable is None or mode in self.runnable,
        )  # fmt: skip


def test_a_failsafe_holds_for_the_delay_then_acts_and_continues_without_its_cause() -> None:
    machine = FailsafeMachine()
    assert machine.update_after(0.0, LOST_GCS) == Decision(Action.HOLD, Cause.GCS_LOSS, Action.RTL)
    assert machine.update_after(4.9, LOST_GCS).action is Action.HOLD
    assert machine.update_after(0.2, LOST_GCS) == Decision(Action.RTL, Cause.GCS_LOSS)
    assert machine.update_after(1.0).action is Action.RTL, "the return ended when the link was back"
    machine.failsafe.on_mode_change()
    assert machine.update_after(0.1).action is Action.NONE


def test_a_worse_condition_does_not_restart_the_delay() -> None:
    machine = FailsafeMachine()
    assert machine.update_after(0.0, LOW_BATTERY).action is Action.WARN
    assert machine.update_after(1.0, LOW_BATTERY, LOST_GCS).pending is Action.RTL
    assert machine.update_after(3.0, LOW_BATTERY, LOST_GCS, EMPTY_BATTERY).pending is Action.LAND
    assert machine.update_after(2.1, LOW_BATTERY, LOST_GCS, EMPTY_BATTERY) == Decision(
        Action.LAND, Cause.BATTERY_EMERGENCY
    )


def test_a_takeover_lasts_until_a_new_condition() -> None:
    machine = FailsafeMachine()
    machine.update_after(0.0, LOST_GCS)
    machine.failsafe.on_mode_change()
    assert machine.update_after(6.0, LOST_GCS).action is Action.NONE
    assert machine.update_after(0.1, LOST_GCS, EMPTY_BATTERY).action is Action.HOLD
    attitude_failure = ActionOptions(
        "attitude", Action.TERMINATE, clear=ClearCondition.NEVER, takeover=UserTakeover.NEVER
    )
    assert machine.update_after(0.1, attitude_failure).action is Action.TERMINATE
    machine.failsafe.on_mode_change()
    assert machine.update_after(0.1).action is Action.TERMINATE


def test_an_action_that_cannot_run_is_replaced_and_a_landing_is_not_interrupted() -> None:
    machine = FailsafeMachine()
    machine.runnable = frozenset()
    assert machine.update_after(0.0, LOST_GCS).action is Action.DESCEND
    machine = FailsafeMachine()
    machine.intended = NavState.LAND
    assert machine.update_after(0.0, ActionOptions("fence", Action.RTL)).action is Action.WARN


@pytest.mark.parametrize(
    ("conditions", "action", "cause"),
    [
        ({"gcs_lost": True, "gcs_loss_action": 0}, Action.NONE, Cause.GENERIC),
        ({"gcs_lost": True, "gcs_loss_action": 1}, Action.HOLD, Cause.GCS_LOSS),
        ({"gcs_lost": True, "gcs_loss_action": 2}, Action.RTL, Cause.GCS_LOSS),
        ({"gcs_lost": True, "gcs_loss_action": 5}, Action.TERMINATE, Cause.GCS_LOSS),
        ({"gcs_lost": True, "gcs_loss_action": 6}, Action.DISARM, Cause.GCS_LOSS),
        ({"gcs_lost": True, "gcs_loss_action": 2, "gcs_loss_except": 2}, Action.NONE, Cause.GENERIC),
        ({"manual_lost": True, "manual_loss_action": 2}, Action.RTL, Cause.MANUAL_CONTROL_LOSS),
        ({"manual_lost": True, "manual_loss_action": 3}, Action.LAND, Cause.MANUAL_CONTROL_LOSS),
        ({"manual_lost": True, "manual_loss_action": 2, "manual_loss_except": 2}, Action.NONE, Cause.GENERIC),
        ({"battery_warning": 1, "low_battery_action": 3}, Action.WARN, Cause.BATTERY_LOW),
        ({"battery_warning": 2, "low_battery_action": 0}, Action.WARN, Cause.BATTERY_CRITICAL),
        ({"battery_warning": 3, "low_battery_action": 1}, Action.RTL, Cause.BATTERY_EMERGENCY),
        ({"battery_warning": 2, "low_battery_action": 2}, Action.LAND, Cause.BATTERY_CRITICAL),
        ({"battery_warning": 2, "low_battery_action": 3}, Action.RTL, Cause.BATTERY_CRITICAL),
        ({"battery_warning": 3, "low_battery_action": 3}, Action.LAND, Cause.BATTERY_EMERGENCY),
        ({"fence_breached": True, "fence_action": 0}, Action.NONE, Cause.GENERIC),
        ({"fence_breached": True, "fence_action": 2}, Action.HOLD, Cause.GENERIC),
        ({"wind_too_high": True, "wind_action": 3}, Action.RTL, Cause.GENERIC),
        ({"flight_time_over": True}, Action.RTL, Cause.GENERIC),
        ({"attitude_failure": True}, Action.WARN, Cause.GENERIC),
        ({"attitude_failure": True, "may_terminate": True}, Action.TERMINATE, Cause.GENERIC),
        ({"attitude_failure": True, "just_armed": True}, Action.DISARM, Cause.GENERIC),
        ({"position_lost": True}, Action.DESCEND, Cause.GENERIC),
    ],
)
def test_each_condition_triggers_the_action_of_its_parameter(conditions, action, cause) -> None:
    actions = flight_actions(Conditions(mode=NavState.HOLD, **conditions))
    worst = max(actions, key=lambda options: options.action, default=ActionOptions("none", Action.NONE))
    assert (worst.action, worst.cause) == (action, cause)


def test_com_lkdown_tko_sets_how_long_an_attitude_failure_disarms_after_spool_up() -> None:
    station = PlanStation()
    watch = station.sim.autopilots[0].commander.failsafe_watch
    for name, value in (("COM_SPOOLUP_TIME", 1.0), ("COM_LKDOWN_TKO", 3.0)):
        station.sim.set_parameter(0, name, value)
    assert [watch.in_early_takeoff(armed_for_s) for armed_for_s in (3.9, 4.1)] == [True, False]
    station.sim.set_parameter(0, "COM_LKDOWN_TKO", 5.0)
    assert watch.in_early_takeoff(4.1)


def test_a_vehicle_with_stick_input_switches_to_altitude_mode_after_a_lost_position() -> None:
    position_lost = {"mode": NavState.POSITION, "position_lost": True}
    assert flight_actions(Conditions(**position_lost, sticks=True))[0].action is Action.FALLBACK_ALTITUDE
    assert (
        flight_actions(Conditions(**position_lost, sticks=True, position_loss_lands=True))[0].action
        is Action.DESCEND
    )
    assert flight_actions(Conditions(**position_lost))[0].action is Action.DESCEND


def hovering_station(
    height_m: float = 3.0, *, sensor_noise: bool = False, **parameters: float
) -> PlanStation:
    return station_in_hover(
        PlanStation, height_m, {"COM_FAIL_ACT_T": 1.0, **parameters}, sensor_noise=sensor_noise
    )


@pytest.mark.story
def test_a_return_after_a_lost_link_continues_when_the_link_is_back() -> None:
    station = hovering_station(NAV_DLL_ACT=2, COM_DL_LOSS_T=5, RTL_RETURN_ALT=4.0)
    station.heartbeats = False
    since_s = station.now_s
    station.run_until(lambda: station.active_mode == RTL_MODE, 8)
    assert station.events(since_s).index("commander_gcs_lost") < station.events(since_s).index(
        "commander_failsafe_enter_hold"
    )
    assert "commander_failsafe_enter" in station.events(since_s)
    station.heartbeats, station._next_heartbeat_s = True, station.now_s
    station.run(0.5)
    assert "GCS connection regained\t" in station.status_texts()
    assert station.active_mode == RTL_MODE
    station.run_until(lambda: not station.armed, 25)


def test_lost_sticks_trigger_a_return() -> None:
    station = hovering_station(NAV_RCL_ACT=2, RTL_RETURN_ALT=4.0)
    station.run(1.0, lambda: station.send("MANUAL_CONTROL", target=1, z=500))
    assert station.active_mode == HOLD_MODE
    lost_s = station.now_s
    station.run(1.2)
    assert station.events(lost_s).index("commander_rc_lost") < station.events(lost_s).index(
        "commander_failsafe_enter_hold"
    )
    station.run(0.6)
    assert station.active_mode == RTL_MODE
    station.run(0.2, lambda: station.send("MANUAL_CONTROL", target=1, z=500))
    assert "commander_rc_regained" in station.events()


def test_an_empty_battery_warns_returns_and_lands() -> None:
    station = hovering_station(COM_LOW_BAT_ACT=3, SIM_BAT_ENABLE=0)
    simulation = station.sim.simulation
    simulation.set_battery_remaining(0, 0.14)
    station.run(0.1)
    assert station.status_texts()[-2:] == ["Low battery\t", "Failsafe activated\t"]
    simulation.set_battery_remaining(0, 0.06)
    station.run(0.1)
    assert "check_battery_critical" in station.events()
    assert station.status_texts()[-1] == "Failsafe activated: entering Hold for 1 seconds\t"
    assert "Critical battery\t" not in station.status_texts(), (
        "a check that triggers a failsafe sent its text"
    )
    simulation.set_battery_remaining(0, 0.04)
    station.run(1.1)
    assert (station.active_mode, station.newest_messages["CURRENT_MODE"].intended_custom_mode) == (
        LAND_MODE,
        HOLD_MODE,
    )
    station.run_until(lambda: not station.armed, 25)


def test_a_vehicle_returns_when_its_flight_time_is_over() -> None:
    station = hovering_station(COM_FLT_TIME_MAX=14)
    station.run_until(lambda: station.active_mode == RTL_MODE, 15)
    assert "Approaching max flight time (system will RTL in 10 seconds)\t" in station.status_texts()
    assert "check_flight_time_limit" in station.events()


@pytest.mark.story
def test_wind_is_estimated_and_too_strong_wind_triggers_a_landing() -> None:
    # The drag of the airframe (SIH_KDV / SIH_MASS), as identified for a real airframe.
    drag = {"EKF2_DRAG_CTRL": 1, "EKF2_MCOEF": 1.0, "EKF2_BCOEF_X": 0.0, "EKF2_BCOEF_Y": 0.0}
    wind = drag | {"COM_WIND_WARN": 2.0, "COM_WIND_MAX": 4.0, "COM_WIND_MAX_ACT": 5}
    station = PlanStation(parameters=wind | {"COM_FAIL_ACT_T": 1.0}, sensor_noise=False)  # read at boot
    station.wait_until_ready_to_arm()
    station.take_off_and_hover(3.0)
    monitors = station.sim.autopilots[0].commander.monitors
    assert monitors.wind_m_s < 0.5
    station.sim.simulation.set_wind([0.0, -6.0, 0.0])
    station.run_until(lambda: station.active_mode == LAND_MODE, 12)
    assert any(text.startswith("High wind speed detected") for text in station.status_texts())
    station.run(3)
    assert monitors.wind_m_s == pytest.approx(6.0, abs=1.5)


def sensor_flags(station: PlanStation) -> tuple[int, ...]:
    """Present, enabled and healthy sensors in SYS_STATUS."""
    status = station.newest_messages["SYS_STATUS"].values
    return tuple(status[f"onboard_control_sensors_{state}"] for state in ("present", "enabled", "health"))


def test_a_vehicle_without_a_position_estimate_descends() -> None:
    # With sensor noise the estimated velocity drifts; the landing must still be detected.
    station = hovering_station(sensor_noise=True)
    assert sensor_flags(station) == (0x300402F, 0x301402F, 0x1320C83F), "as recorded"
    station.sim.simulation.set_gps_enabled(0, False)
    station.run_until(lambda: "commander_failsafe_enter_autopilot_disengaged" in station.events(), 12)
    assert station.sim.autopilots[0].commander.active is NavState.DESCEND
    station.run(1.0)
    assert sensor_flags(station) == (0x300402F, 0x301402F, 0x1320883F), "as recorded"
    station.run_until(lambda: "check_estimator_gnss_fusion_stopped" in station.events(), 3)
    station.run(1.0)
    assert sensor_flags(station) == (0x300400F, 0x301400F, 0x1320883F), "as recorded"
    station.run_until(lambda: not station.armed, 20)


@pytest.mark.parametrize("may_terminate", [False, True])
def test_a_stopped_motor_is_detected_by_the_tilt_as_recorded(may_terminate: bool) -> None:
    station = hovering_station(4.0, CBRK_FLIGHTTERM=0 if may_terminate else 121212)
    station.run(3.0)
    station.sim.simulation.motor_health[0, 0] = 0.0
    stopped_s = station.now_s
    station.run(0.3)
    assert station.sim.simulation.truth.rotor_thrust[0, 0] < 0.01
    assert not [event for event in station.events() if "failure_detector" in event]
    station.run_until(lambda: "check_failure_detector_roll" in station.events(), 2)
    assert station.now_s - stopped_s == pytest.approx(0.76, abs=0.15)
    station.run(2.5)
    assert station.height_m < 0.5
    terminated = station.active_mode == TERMINATION_MODE
    assert terminated is may_terminate, "CBRK_FLIGHTTERM was ignored"


@pytest.mark.parametrize(
    ("name", "value", "event", "component"),
    [
        ("COM_PARACHUTE", 1, "check_parachute_missing", 26),
        pytest.param("COM_CPU_MAX", 95, "check_missing_cpuload", 20, marks=pytest.mark.broad),
        pytest.param("SYS_HAS_NUM_DIST", 2, "check_distance_sensor_missing", 6, marks=pytest.mark.broad),
        pytest.param("SYS_HAS_NUM_OF", 1, "check_optical_sensor_missing", 4, marks=pytest.mark.broad),
    ],
)
def test_missing_required_hardware_denies_arming(name: str, value: int, event: str, component: int) -> None:
    station = PlanStation(sensor_noise=False, parameters={name: value})
    station.run(12.0)
    assert event in station.events()
    summary = next(
        message
        for message in reversed(station.received("EVENT"))
        if EVENT_NAMES[message.values["id"]] == "commander_health_summary"
    )
    assert int.from_bytes(bytes(summary.values["arguments"][5:9]), "little") == 1 << component, (
        "components with health errors"
    )
    station.command(ARM, 1)
    station.run(0.5)
    assert station.acks(ARM) == [1]
    assert not station.armed
    station.sim.autopilots[0].view.parameters.set(name, 0)
    station.run(5.0)
    station.command(ARM, 1)
    station.run(0.5)
    assert station.acks(ARM) == [1, 0]
    assert station.armed


HEALTHY = health.CheckInputs(
    NavState.HOLD, False, True, True, True, True, True, True, False, 0, False
)  # fmt: skip


def test_a_limit_of_the_load_denies_arming_in_every_mode_because_nothing_measures_the_load() -> None:
    unlimited = health.run_checks(HEALTHY)
    limited = health.run_checks(HEALTHY._replace(load_limited=True))
    assert unlimited.armable(NavState.HOLD)
    assert limited.can_arm == 0
    assert limited.can_run == unlimited.can_run
    assert {finding.text for finding in {*limited.findings} - {*unlimited.findings}} == {
        "Preflight Fail: No CPU and RAM load information"
    }


UNITS_WITHOUT_REPLY = (0, 1, 2, 3, 4, 5, 6, 7, 8, 102, 103, 104, 105)
"""FAILURE_UNIT: gyro to airspeed, servo, avoidance, remote control, MAVLink."""


def test_injected_failures_get_the_recorded_results_for_every_unit_and_kind() -> None:
    station = PlanStation(sensor_noise=False)
    station.wait_until_ready_to_arm()

    def inject_all_kinds(unit: int) -> list[int]:
        requested_s = station.now_s
        for kind in range(8):
            station.command(INJECT_FAILURE, unit, kind, 0)
        station.command(INJECT_FAILURE, unit, 0, 0)
        station.run(0.1)
        return station.acks(INJECT_FAILURE, requested_s)

    for unit in UNITS_WITHOUT_REPLY:
        assert inject_all_kinds(unit) == [], unit
    assert inject_all_kinds(100) == [0, 0, 0], "battery: OK, OFF, and OK again"
    assert inject_all_kinds(101) == [0, 0, 3, 3, 0, 3, 3, 3, 0], "motors: OK, OFF and WRONG"
    assert station.sim.simulation.motor_health.all(), (
        "the fault masks only ESC telemetry, which does not exist"
    )
    station.sim.autopilots[0].view.parameters.set("SYS_FAILURE_EN", 0)
    assert inject_all_kinds(4) == [2] * 9, "denied while failure injection is disabled"
    assert math.isfinite(station.sim.autopilots[0].view.estimate.lat_deg)


def test_an_injected_empty_battery_is_detected_as_fast_as_recorded() -> None:
    station = hovering_station(COM_LOW_BAT_ACT=3, COM_FAIL_ACT_T=5.0)
    station.sim.simulation.set_battery_remaining(0, 0.508)
    begin_s = station.now_s
    station.command(INJECT_FAILURE, 100, 1, 0)
    checks = station.sim.autopilots[0].commander.checks
    for level, after_s in ((1, 1.3), (2, 2.1), (3, 2.4)):
        station.run_until(lambda level=level: checks.battery_warning >= level, 5)
        assert station.now_s - begin_s == pytest.approx(after_s, abs=0.25)
    station.run_until(lambda: station.active_mode == LAND_MODE, 12)
    assert station.now_s - begin_s == pytest.approx(7.1, abs=0.4)
    assert "Emergency battery level\t" in station.status_texts()
    assert "Critical battery\t" not in station.status_texts()
