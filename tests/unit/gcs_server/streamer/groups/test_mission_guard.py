"""The guard of a mission for several vehicles: which vehicles it checks, and which it stops."""

from __future__ import annotations

import math
from dataclasses import replace

from gcs_server.streamer.separation import GroupGuard, MemberView
from gcs_server.streamer.values.limit_values import Bounds
from gcs_server.streamer.values.snapshot import Snapshot
from missions.geodesy import LocalOrigin

NOW_S = 101.0


def view_of(east_m: float, phase: str = "streaming", **changes: object) -> MemberView:
    """A hovering vehicle with an exact estimate."""
    origin = LocalOrigin(47.0, 8.0, 500.0)
    snapshot = Snapshot(
        NOW_S, "offboard", (0.0, east_m, -10.0), (0.0, 0.0, 0.0), 0.0, armed=True,
        bounds=Bounds(origin=origin), accuracy_m=0.0,
    )  # fmt: skip
    return MemberView(phase, None, replace(snapshot, **changes), None)  # type: ignore[arg-type]


def make_guard() -> GroupGuard:
    members = dict.fromkeys(("1", "2", "3"))
    return GroupGuard("1", {}, members, minimum_m=5.0, start_s=NOW_S, duration_s=math.inf)


def test_the_guard_of_a_mission_checks_armed_vehicles_and_stops_all_vehicles() -> None:
    near_views = {"1": view_of(0.0), "2": view_of(4.0, armed=False), "3": view_of(30.0)}
    mission_guard = make_guard()
    assert mission_guard.check(NOW_S, near_views).hold == {}
    actions = mission_guard.check(NOW_S + 0.1, near_views | {"2": view_of(4.0, "idle")})
    assert list(actions.hold) == ["1", "2", "3"]
    assert [(finding.code, finding.vehicles) for finding in mission_guard.findings] == [
        ("separation", ("1", "2"))
    ]


def test_an_armed_vehicle_without_position_stops_all_vehicles() -> None:
    distant_views = {"1": view_of(0.0), "2": view_of(15.0), "3": view_of(30.0)}
    mission_guard = make_guard()
    assert (
        mission_guard.check(
            NOW_S, distant_views | {"2": view_of(15.0, armed=False, position_ned_m=None)}
        ).hold
        == {}
    )
    actions = mission_guard.check(NOW_S + 0.1, distant_views | {"2": view_of(15.0, lost=True)})
    assert list(actions.hold) == ["1", "2", "3"]
    assert mission_guard.findings[-1].code == "place_unknown"


def test_a_vehicle_whose_stream_has_ended_stays_a_member_of_the_mission() -> None:
    views = {"1": view_of(0.0), "2": view_of(15.0, "idle"), "3": view_of(30.0, "idle", armed=False)}
    mission_guard = make_guard()
    assert mission_guard.check(NOW_S, views).hold == {}
    idle_views = {vehicle: replace(view, phase="idle") for vehicle, view in views.items()}
    assert mission_guard.check(NOW_S + 1.0, idle_views).hold == {}
    assert (mission_guard.phase, mission_guard.until_s, list(mission_guard.findings)) == (
        "flying",
        math.inf,
        [],
    )
