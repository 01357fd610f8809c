"""The corridor of a dry run, in the local frame of the real vehicle that flies the mission."""

import pytest

from gcs_server.errors import Refused
from gcs_server.flights.dry_run_paths import corridor_of, path_of
from missions.geodesy import LocalOrigin

ORIGIN = LocalOrigin(47.0, 8.0, 480.0)
START_NED_M = (30.0, -20.0, -5.0)


def mission_dry_run(**changes):
    lat, lon, alt = ORIGIN.to_geodetic(START_NED_M)
    bands = {"p5": [-0.2, -0.4], "p50": [0.0, 0.0], "p95": [0.3, 0.6], "greatest": [0.5, -1.5]}
    corridor = {
        "position_ned_m": [[0.0, 0.0, 0.0], [10.0, 0.0, -8.0]],
        "horizontal_m": {**bands, "greatest": [0.5, 1.5]},
        "vertical_m": bands,
    }
    origin = {"lat_deg": lat, "lon_deg": lon, "alt_amsl_m": alt}
    result = {"nominal": {"origin": origin}, "monte_carlo": {"corridor": corridor}, "group": None}
    return {"id": "3", "kind": "offboard_mission", **result, **changes}


def test_the_corridor_begins_at_the_start_and_contains_all_flights():
    corridor = corridor_of(mission_dry_run(), START_NED_M, ORIGIN)
    assert corridor.position_ned_m[1] == pytest.approx((40.0, -20.0, -13.0), abs=0.01)
    assert corridor.beside_m == (0.5, 1.5)
    assert (corridor.above_m, corridor.below_m) == ((0.5, 0.6), (0.2, 1.5))
    assert corridor_of(mission_dry_run(), START_NED_M, None).position_ned_m[0] == START_NED_M


def dry_run_with_roles(**changes):
    """A dry run of two vehicles that start 20 m apart."""
    vehicle_dry_run = mission_dry_run()
    lead_corridor = vehicle_dry_run["monte_carlo"]["corridor"]
    left_corridor = {
        **lead_corridor,
        "position_ned_m": [[n, e + 20.0, d] for n, e, d in lead_corridor["position_ned_m"]],
    }
    roles = {"lead": {"corridor": lead_corridor}, "left": {"corridor": left_corridor}}
    return {**vehicle_dry_run, "group": {"monte_carlo": {"roles": roles}}, **changes}


LEFT_START_NED_M = (START_NED_M[0], START_NED_M[1] + 20.0, START_NED_M[2] + 3.0)
"""Start of the vehicle of the role "left": 20 m east of START_NED_M and 3 m lower."""


def test_the_corridor_of_a_role_begins_at_its_own_vehicle():
    corridor = corridor_of(dry_run_with_roles(), LEFT_START_NED_M, ORIGIN, "left")
    assert corridor.position_ned_m[0] == pytest.approx(LEFT_START_NED_M, abs=0.01)
    assert corridor.position_ned_m[1] == pytest.approx((40.0, 0.0, -10.0), abs=0.01)
    assert corridor_of(dry_run_with_roles(), LEFT_START_NED_M, None, "left").position_ned_m[
        0
    ] == pytest.approx(LEFT_START_NED_M)


@pytest.mark.parametrize(
    ("dry_run", "start_ned_m", "role", "expected"),
    [
        (dry_run_with_roles(), LEFT_START_NED_M, "third", "has no corridor of the role 'third'"),
        (dry_run_with_roles(), START_NED_M, None, "has no corridor of an offboard mission of one vehicle"),
        (mission_dry_run(), START_NED_M, "lead", "has no corridor of the role 'lead'"),
        (dry_run_with_roles(monte_carlo=None), START_NED_M, "lead", "has no corridor of the role 'lead'"),
        (dry_run_with_roles(), START_NED_M, "left", "began 20 m from the vehicle's position"),
    ],
)
def test_a_dry_run_that_does_not_fit_the_role_is_refused(dry_run, start_ned_m, role, expected):
    with pytest.raises(Refused, match=expected):
        corridor_of(dry_run, start_ned_m, ORIGIN, role)


@pytest.mark.parametrize(
    ("dry_run", "start_ned_m", "expected"),
    [
        (mission_dry_run(monte_carlo=None), START_NED_M, "has no corridor"),
        (mission_dry_run(kind="waypoint_plan"), START_NED_M, "has no corridor"),
        (mission_dry_run(), (90.0, -20.0, 0.0), "began 60 m from the vehicle's position"),
    ],
)
def test_a_dry_run_without_corridor_or_with_another_start_is_refused(dry_run, start_ned_m, expected):
    with pytest.raises(Refused, match=expected):
        corridor_of(dry_run, start_ned_m, ORIGIN)


ROWS = (0,)
"""The plan of the dry run has one item."""
PLAN_START_NED_M = (START_NED_M[0] + 1.0, START_NED_M[1] - 1.0, -2.0)


def plan_dry_run(**changes):
    """A dry run of a waypoint plan that started 1 m south and 1 m east of `PLAN_START_NED_M`."""
    vehicle_dry_run = mission_dry_run()
    path_ned_m = [[0.0, 0.0, 0.0], [5.0, 0.0, -8.0], [10.0, 0.0, 0.0]]
    nominal = {
        **vehicle_dry_run["nominal"], "finished": True, "landed": True, "duration_s": 4.0,
        "path": {"t_s": [0.0, 2.0, 4.0], "position_ned_m": path_ned_m},
        "steps": [{"place": "item 1", "title": "Return home", "row": 0, "start_s": 0.0, "end_s": 4.0}],
    }  # fmt: skip
    return {**vehicle_dry_run, "kind": "waypoint_plan", "nominal": {**nominal, **changes}}


def test_the_path_of_a_plan_begins_at_the_vehicles_altitude_and_the_dry_runs_horizontal_position():
    path, corridor = path_of(plan_dry_run(), ROWS, PLAN_START_NED_M, ORIGIN)
    assert path.passes[0].leg.points[1] == pytest.approx(
        (2.0, START_NED_M[0] + 5.0, START_NED_M[1], -10.0), abs=0.01
    )
    assert corridor.position_ned_m[1] == pytest.approx(
        (START_NED_M[0] + 10.0, START_NED_M[1], -10.0), abs=0.01
    )
    assert path_of({**plan_dry_run(), "monte_carlo": None}, ROWS, PLAN_START_NED_M, ORIGIN)[1] is None


@pytest.mark.parametrize(
    ("dry_run", "start_ned_m", "expected"),
    [
        (plan_dry_run(finished=False), PLAN_START_NED_M, "has not flown the whole plan"),
        (plan_dry_run(path=None), PLAN_START_NED_M, "has not flown the whole plan"),
        (
            plan_dry_run(),
            (START_NED_M[0] + 6.0, START_NED_M[1], 0.0),
            "began 6 m from the vehicle's position",
        ),
    ],
)
def test_a_dry_run_that_does_not_fit_the_start_of_a_plan_is_refused(dry_run, start_ned_m, expected):
    with pytest.raises(Refused, match=expected):
        path_of(dry_run, ROWS, start_ned_m, ORIGIN)
