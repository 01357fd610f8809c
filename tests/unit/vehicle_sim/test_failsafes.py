"""Failsafes: the state machine alone, and whole flights with a failsafe."""

import math

import pytest

from tests.unit.vehicle_sim.plan_station import TERMINATION, PlanStation
from tests.unit.vehicle_sim.prepared_stations import hovering
from tests.unit.vehicle_sim.sim_station import EVENT_NAMES, HOLD, LAND, RTL
from vehicle_sim.autopilot.demands import Conditions, flight_demands
from vehicle_sim.autopilot.failsafe import Action, Cause, Clear, Decision, Demand, Failsafe, Takeover
from vehicle_sim.autopilot.modes import NavState

pytestmark = pytest.mark.flight

GCS = Demand("gcs", Action.RTL, Cause.GCS_LOSS, Clear.ON_MODE_CHANGE)
LOW = Demand("battery", Action.WARN, Cause.BATTERY_LOW)
LANDS = Demand("battery", Action.LAND, Cause.BATTERY_EMERGENCY)


class Machine:
    """A failsafe state machine with a fake clock."""

    def __init__(self) -> None:
        self.failsafe, self.now_s, self.intended = Failsafe(), 0.0, NavState.HOLD
        self.can: frozenset[NavState] | None = None

    def after(self, seconds: float, *wrong: Demand) -> Decision:
        self.now_s += seconds
        return self.failsafe.update(
            self.now_s, wrong, intended=self.intended, delay_s=5.0,
            can_run=lambda mode: self.can is None or mode in self.can,
        )  # fmt: skip


def test_a_failsafe_holds_for_the_delay_then_acts_and_continues_without_its_cause() -> None:
    m = Machine()
    assert m.after(0.0, GCS) == Decision(Action.HOLD, Cause.GCS_LOSS, Action.RTL)
    assert m.after(4.9, GCS).action is Action.HOLD
    assert m.after(0.2, GCS) == Decision(Action.RTL, Cause.GCS_LOSS)
    assert m.after(1.0).action is Action.RTL, "the return continues although the link is back"
    m.failsafe.on_mode_change()
    assert m.after(0.1).action is Action.NONE


def test_a_worse_condition_does_not_restart_the_delay() -> None:
    m = Machine()
    assert m.after(0.0, LOW).action is Action.WARN
    assert m.after(1.0, LOW, GCS).pending is Action.RTL
    assert m.after(3.0, LOW, GCS, LANDS).pending is Action.LAND
    assert m.after(2.1, LOW, GCS, LANDS) == Decision(Action.LAND, Cause.BATTERY_EMERGENCY)


def test_a_takeover_lasts_until_a_new_condition() -> None:
    m = Machine()
    m.after(0.0, GCS)
    m.failsafe.on_mode_change()
    assert m.after(6.0, GCS).action is Action.NONE
    assert m.after(0.1, GCS, LANDS).action is Action.HOLD
    final = Demand("attitude", Action.TERMINATE, clear=Clear.NEVER, takeover=Takeover.NEVER)
    assert m.after(0.1, final).action is Action.TERMINATE
    m.failsafe.on_mode_change()
    assert m.after(0.1).action is Action.TERMINATE


def test_an_action_that_cannot_run_is_replaced_and_a_landing_is_not_interrupted() -> None:
    m = Machine()
    m.can = frozenset()
    assert m.after(0.0, GCS).action is Action.DESCEND
    m = Machine()
    m.intended = NavState.LAND
    assert m.after(0.0, Demand("fence", Action.RTL)).action is Action.WARN


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
    found = flight_demands(Conditions(mode=NavState.HOLD, **conditions))
    worst = max(found, key=lambda demand: demand.action, default=Demand("none", Action.NONE))
    assert (worst.action, worst.cause) == (action, cause)


def test_with_sticks_a_lost_position_falls_back_to_altitude_mode() -> None:
    lost = {"mode": NavState.POSITION, "position_lost": True}
    assert flight_demands(Conditions(**lost, sticks=True))[0].action is Action.FALLBACK_ALTITUDE
    assert (
        flight_demands(Conditions(**lost, sticks=True, position_loss_lands=True))[0].action is Action.DESCEND
    )
    assert flight_demands(Conditions(**lost))[0].action is Action.DESCEND


def flying(height_m: float = 3.0, *, sensor_noise: bool = False, **parameters: float) -> PlanStation:
    return hovering(PlanStation, height_m, {"COM_FAIL_ACT_T": 1.0, **parameters}, sensor_noise=sensor_noise)


@pytest.mark.story
def test_a_return_after_a_lost_link_continues_when_the_link_is_back() -> None:
    s = flying(NAV_DLL_ACT=2, COM_DL_LOSS_T=5, RTL_RETURN_ALT=4.0)
    s.heartbeats = False
    since_s = s.now_s
    s.run_until(lambda: s.active_mode == RTL, 8)
    assert s.events(since_s).index("commander_gcs_lost") < s.events(since_s).index(
        "commander_failsafe_enter_hold"
    )
    assert "commander_failsafe_enter" in s.events(since_s)
    s.heartbeats, s._next_heartbeat_s = True, s.now_s
    s.run(0.5)
    assert "GCS connection regained\t" in s.texts()
    assert s.active_mode == RTL
    s.run_until(lambda: not s.armed, 25)


def test_lost_sticks_trigger_a_return() -> None:
    s = flying(NAV_RCL_ACT=2, RTL_RETURN_ALT=4.0)
    s.run(1.0, lambda: s.send("MANUAL_CONTROL", target=1, z=500))
    assert s.active_mode == HOLD
    lost_s = s.now_s
    s.run(1.2)
    assert s.events(lost_s).index("commander_rc_lost") < s.events(lost_s).index(
        "commander_failsafe_enter_hold"
    )
    s.run(0.6)
    assert s.active_mode == RTL
    s.run(0.2, lambda: s.send("MANUAL_CONTROL", target=1, z=500))
    assert "commander_rc_regained" in s.events()


def test_an_empty_battery_warns_returns_and_lands() -> None:
    s = flying(COM_LOW_BAT_ACT=3, SIM_BAT_ENABLE=0)
    battery = s.sim.simulation
    battery.set_battery_remaining(0, 0.14)
    s.run(0.1)
    assert s.texts()[-2:] == ["Low battery\t", "Failsafe activated\t"]
    battery.set_battery_remaining(0, 0.06)
    s.run(0.1)
    assert "check_battery_critical" in s.events()
    assert s.texts()[-1] == "Failsafe activated: entering Hold for 1 seconds\t"
    assert "Critical battery\t" not in s.texts(), "no texts for checks that trigger a failsafe"
    battery.set_battery_remaining(0, 0.04)
    s.run(1.1)
    assert (s.active_mode, s.last["CURRENT_MODE"].intended_custom_mode) == (LAND, HOLD)
    s.run_until(lambda: not s.armed, 25)


def test_a_flight_longer_than_allowed_returns() -> None:
    s = flying(COM_FLT_TIME_MAX=14)
    s.run_until(lambda: s.active_mode == RTL, 15)
    assert "Approaching max flight time (system will RTL in 10 seconds)\t" in s.texts()
    assert "check_flight_time_limit" in s.events()


@pytest.mark.story
def test_wind_is_estimated_and_too_strong_wind_triggers_a_landing() -> None:
    # The drag of the airframe (SIH_KDV / SIH_MASS), as identified for a real one.
    drag = {"EKF2_DRAG_CTRL": 1, "EKF2_MCOEF": 1.0, "EKF2_BCOEF_X": 0.0, "EKF2_BCOEF_Y": 0.0}
    wind = drag | {"COM_WIND_WARN": 2.0, "COM_WIND_MAX": 4.0, "COM_WIND_MAX_ACT": 5}
    s = PlanStation(parameters=wind | {"COM_FAIL_ACT_T": 1.0}, sensor_noise=False)  # read at boot
    s.ready_to_arm()
    s.fly_to(3.0)
    monitors = s.sim.autopilots[0].commander.monitors
    assert monitors.wind_m_s < 0.5
    s.sim.simulation.set_wind([0.0, -6.0, 0.0])
    s.run_until(lambda: s.active_mode == LAND, 12)
    assert any(text.startswith("High wind speed detected") for text in s.texts())
    s.run(3)
    assert monitors.wind_m_s == pytest.approx(6.0, abs=1.5)


def sensors(station: PlanStation) -> tuple[int, ...]:
    """Present, enabled and healthy sensors in SYS_STATUS."""
    status = station.last["SYS_STATUS"].values
    return tuple(status[f"onboard_control_sensors_{what}"] for what in ("present", "enabled", "health"))


def test_without_a_position_the_vehicle_descends() -> None:
    # With noise: the estimated velocity drifts, and the landing is still detected.
    s = flying(sensor_noise=True)
    assert sensors(s) == (0x300402F, 0x301402F, 0x1320C83F), "as recorded"
    s.sim.simulation.set_gps_enabled(0, False)
    s.run_until(lambda: "commander_failsafe_enter_autopilot_disengaged" in s.events(), 12)
    assert s.sim.autopilots[0].commander.active is NavState.DESCEND
    s.run(1.0)
    assert sensors(s) == (0x300402F, 0x301402F, 0x1320883F), "as recorded"
    s.run_until(lambda: "check_estimator_gnss_fusion_stopped" in s.events(), 3)
    s.run(1.0)
    assert sensors(s) == (0x300400F, 0x301400F, 0x1320883F), "as recorded"
    s.run_until(lambda: not s.armed, 20)


@pytest.mark.parametrize("may_terminate", [False, True])
def test_a_stopped_motor_is_detected_by_the_tilt_as_recorded(may_terminate: bool) -> None:
    s = flying(4.0, CBRK_FLIGHTTERM=0 if may_terminate else 121212)
    s.run(3.0)
    s.sim.simulation.motor_health[0, 0] = 0.0
    stopped_s = s.now_s
    s.run(0.3)
    assert s.sim.simulation.truth.rotor_thrust[0, 0] < 0.01
    assert not [event for event in s.events() if "failure_detector" in event]
    s.run_until(lambda: "check_failure_detector_roll" in s.events(), 2)
    assert s.now_s - stopped_s == pytest.approx(0.76, abs=0.15)
    s.run(2.5)
    assert s.height_m < 0.5
    terminated = s.active_mode == TERMINATION
    assert terminated is may_terminate, "CBRK_FLIGHTTERM"


@pytest.mark.parametrize(
    ("name", "value", "event", "component"),
    [
        ("COM_PARACHUTE", 1, "check_parachute_missing", 26),
        pytest.param("SYS_HAS_NUM_DIST", 2, "check_distance_sensor_missing", 6, marks=pytest.mark.broad),
        pytest.param("SYS_HAS_NUM_OF", 1, "check_optical_sensor_missing", 4, marks=pytest.mark.broad),
    ],
)
def test_missing_required_hardware_denies_arming(name: str, value: int, event: str, component: int) -> None:
    s = PlanStation(sensor_noise=False, parameters={name: value})
    s.run(12.0)
    assert event in s.events()
    summary = next(
        m for m in reversed(s.received("EVENT")) if EVENT_NAMES[m.values["id"]] == "commander_health_summary"
    )
    assert int.from_bytes(bytes(summary.values["arguments"][5:9]), "little") == 1 << component, (
        "components with health errors"
    )
    s.command(400, 1)
    s.run(0.5)
    assert s.acks(400) == [1]
    assert not s.armed
    s.sim.autopilots[0].view.parameters.set(name, 0)
    s.run(5.0)
    s.command(400, 1)
    s.run(0.5)
    assert s.acks(400) == [1, 0]
    assert s.armed


SENSORS_AND_OTHERS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 102, 103, 104, 105)
"""FAILURE_UNIT: gyro to airspeed, servo, avoidance, remote control, MAVLink."""


def test_failures_are_answered_as_recorded_for_every_unit_and_kind() -> None:
    s = PlanStation(sensor_noise=False)
    s.ready_to_arm()

    def answers(unit: int) -> list[int]:
        requested_s = s.now_s
        for kind in range(8):
            s.command(420, unit, kind, 0)
        s.command(420, unit, 0, 0)
        s.run(0.1)
        return s.acks(420, requested_s)

    for unit in SENSORS_AND_OTHERS:
        assert answers(unit) == [], unit
    assert answers(100) == [0, 0, 0], "the battery: OK, OFF, and OK again"
    assert answers(101) == [0, 0, 3, 3, 0, 3, 3, 3, 0], "motors: OK, OFF and WRONG"
    assert s.sim.simulation.motor_health.all(), "the fault masks only ESC telemetry, which does not exist"
    s.sim.autopilots[0].view.parameters.set("SYS_FAILURE_EN", 0)
    assert answers(4) == [2] * 9, "denied while failure injection is disabled"
    assert math.isfinite(s.sim.autopilots[0].view.estimate.lat_deg)


def test_an_injected_empty_battery_is_detected_as_fast_as_recorded() -> None:
    s = flying(COM_LOW_BAT_ACT=3, COM_FAIL_ACT_T=5.0)
    s.sim.simulation.set_battery_remaining(0, 0.508)
    begun_s = s.now_s
    s.command(420, 100, 1, 0)
    checks = s.sim.autopilots[0].commander.checks
    for level, after_s in ((1, 1.3), (2, 2.1), (3, 2.4)):
        s.run_until(lambda level=level: checks.battery_warning >= level, 5)
        assert s.now_s - begun_s == pytest.approx(after_s, abs=0.25)
    s.run_until(lambda: s.active_mode == LAND, 12)
    assert s.now_s - begun_s == pytest.approx(7.1, abs=0.4)
    assert "Emergency battery level\t" in s.texts()
    assert "Critical battery\t" not in s.texts()
