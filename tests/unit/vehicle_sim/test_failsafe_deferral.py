"""Deferred failsafes: which failsafes are deferred, for how long, and when they act afterwards."""

from __future__ import annotations

import pytest

from vehicle_sim.autopilot.failsafe import Action, ActionOptions, ClearCondition, Failsafe
from vehicle_sim.autopilot.failsafe_actions import Conditions, flight_actions
from vehicle_sim.autopilot.modes import NavState

LOST_GCS = ActionOptions("gcs", Action.LAND, clear=ClearCondition.ON_MODE_CHANGE, deferrable=True)
UNAVAILABLE_MODE = ActionOptions("mode", Action.RTL)


def decide(machine: Failsafe, now_s: float, *actions: ActionOptions) -> Action:
    decision = machine.update(
        now_s, actions, intended=NavState.EXTERNAL1, can_run=lambda mode: True, delay_s=0.0
    )
    return decision.action


def test_a_deferred_failsafe_does_not_act_and_is_reported():
    machine = Failsafe()
    machine.defer(True, -1)
    assert machine.deferral == 1
    assert decide(machine, 0.0, LOST_GCS) is Action.NONE
    assert machine.deferral == 2
    assert decide(machine, 1000.0, LOST_GCS) is Action.NONE


@pytest.mark.parametrize(("timeout_s", "end_s"), [(4, 4.0), (0, 30.0)])
def test_a_deferral_ends_after_its_timeout(timeout_s, end_s):
    machine = Failsafe()
    machine.defer(True, timeout_s)
    decide(machine, 0.0, LOST_GCS)
    assert decide(machine, end_s - 0.1, LOST_GCS) is Action.NONE
    assert decide(machine, end_s + 0.1, LOST_GCS) is Action.LAND
    machine.defer(True, timeout_s)
    assert machine.deferral == 0, "deferred while a failsafe acts"


def test_a_failsafe_acts_after_a_withdrawn_deferral_although_its_cause_is_gone():
    machine = Failsafe()
    machine.defer(True, -1)
    decide(machine, 0.0, LOST_GCS)
    decide(machine, 1.0)
    machine.defer(False, 0)
    assert decide(machine, 2.0) is Action.LAND


def test_a_mode_that_cannot_run_is_not_deferred():
    machine = Failsafe()
    machine.defer(True, -1)
    assert decide(machine, 0.0, LOST_GCS, UNAVAILABLE_MODE) is Action.RTL


ALL_CONDITIONS = Conditions(
    mode=NavState.EXTERNAL1,
    manual_lost=True,
    manual_loss_action=2,
    gcs_lost=True,
    gcs_loss_action=2,
    battery_warning=3,
    low_battery_action=3,
    fence_breached=True,
    fence_action=3,
    wind_too_high=True,
    wind_action=3,
    flight_time_over=True,
    attitude_failure=True,
    may_terminate=True,
    external_cannot_run=True,
)


def test_only_lost_links_and_a_low_battery_are_deferred():
    flags = {
        each.name: each.deferrable for each in flight_actions(ALL_CONDITIONS) if each.action > Action.WARN
    }
    assert {name for name, deferrable in flags.items() if deferrable} == {"manual", "gcs", "battery"}
    assert {name for name, deferrable in flags.items() if not deferrable} == {
        "fence", "wind", "flight time", "attitude", "mode",
    }  # fmt: skip
