"""What PX4 v1.16 and v1.17 do when setpoints, sticks, ground station, position or a program's mode are lost,
with their default parameters: the table of `docs/safety.md`."""

from __future__ import annotations

from typing import Any

import pytest

from gcs_server.vehicle.autopilot import autopilot_of
from gcs_server.vehicle.px4.stream_loss import PARAMETERS
from vehicle_sim.autopilot.failsafe import Action
from vehicle_sim.autopilot.failsafe_actions import Conditions, flight_actions
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.parameters import Parameters
from vehicle_sim.px4_version import VERSIONS

DEFAULTS = {
    "offboard_loss_action": "COM_OBL_RC_ACT",
    "manual_loss_action": "NAV_RCL_ACT",
    "manual_loss_except": "COM_RCL_EXCEPT",
    "gcs_loss_action": "NAV_DLL_ACT",
    "gcs_loss_except": "COM_DLL_EXCEPT",
}
"""Parameter of each field of `Conditions`."""


def actions_of(version: str, mode: NavState, **lost: Any) -> list[Action]:
    """The actions in flight with the version's default parameters."""
    px4 = VERSIONS[version]
    store = Parameters(px4=px4)
    defaults = {field: int(store.get(name)) for field, name in DEFAULTS.items()}
    conditions = Conditions(mode, fallback_needs_sticks=px4.fallback_needs_sticks, **{**defaults, **lost})
    return [each.action for each in flight_actions(conditions)]


@pytest.mark.parametrize(
    ("mode", "lost", "v1_16", "v1_17"),
    [
        (NavState.OFFBOARD, {"offboard_lost": True}, Action.FALLBACK_POSITION, Action.RTL),
        (
            NavState.OFFBOARD,
            {"offboard_lost": True, "sticks": True},
            Action.FALLBACK_POSITION,
            Action.FALLBACK_POSITION,
        ),
        (NavState.OFFBOARD, {"offboard_lost": True, "offboard_loss_action": 4}, Action.LAND, Action.LAND),
        (NavState.OFFBOARD, {"position_lost": True}, Action.FALLBACK_ALTITUDE, Action.RTL),
        (NavState.POSITION, {"position_lost": True, "sticks": True}, *[Action.FALLBACK_ALTITUDE] * 2),
        (NavState.MISSION, {"position_lost": True}, Action.DESCEND, Action.DESCEND),
        (NavState.MISSION, {"manual_lost": True}, Action.RTL, Action.RTL),
        (NavState.EXTERNAL1, {"manual_lost": True, "manual_loss_except": 8}, Action.RTL, None),
        (NavState.MISSION, {"gcs_lost": True}, None, None),
        (NavState.MISSION, {"gcs_lost": True, "gcs_loss_action": 2}, Action.RTL, Action.RTL),
        (NavState.EXTERNAL1, {"external_cannot_run": True}, Action.RTL, Action.RTL),
    ],
)
def test_each_loss_has_the_action_of_the_release(
    mode: NavState, lost: dict[str, Any], v1_16: Action | None, v1_17: Action | None
) -> None:
    assert actions_of("1.16", mode, **lost) == ([] if v1_16 is None else [v1_16])
    assert actions_of("1.17", mode, **lost) == ([] if v1_17 is None else [v1_17])


def test_the_server_says_of_each_release_what_the_vehicle_then_does() -> None:
    said = {Action.FALLBACK_POSITION: "it reports Position mode", Action.RTL: "returns to launch"}
    for version, px4 in VERSIONS.items():
        store = Parameters(px4=px4)
        parameters = {name: float(store.get(name)) for name in PARAMETERS}
        text = autopilot_of(12, f"{version}.0").stream_loss(parameters, False).text()
        (action,) = actions_of(version, NavState.OFFBOARD, offboard_lost=True)
        assert said[action] in text
