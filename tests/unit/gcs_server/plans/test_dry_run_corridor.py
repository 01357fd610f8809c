"""The corridor of a dry run in the frame of the vehicle that flies the mission for real."""

import pytest

from gcs_server.errors import Refused
from gcs_server.plans.dry_run_corridor import corridor_of, path_of
from missions.geodesy import LocalOrigin
from missions.plan import read

ORIGIN = LocalOrigin(47.0, 8.0, 480.0)
HERE = (30.0, -20.0, -5.0)


def of_a_mission(**changes):
    lat, lon, alt = ORIGIN.to_geodetic(HERE)
    bands = {"p5": [-0.2, -0.4], "p50": [0.0, 0.0], "p95": [0.3, 0.6], "greatest": [0.5, -1.5]}
    corridor = {
        "position_ned_m": [[0.0, 0.0, 0.0], [10.0, 0.0, -8.0]],
        "horizontal_m": {**bands, "greatest": [0.5, 1.5]},
        "vertical_m": bands,
    }
    origin = {"lat_deg": lat, "lon_deg": lon, "alt_amsl_m": alt}
    whole = {"nominal": {"origin": origin}, "monte_carlo": {"corridor": corridor}, "together": None}
    return {"id": "3", "kind": "offboard_mission", **whole, **changes}


def test_the_corridor_begins_at_the_start_and_contains_all_flights():
    corridor = corridor_of(of_a_mission(), HERE, ORIGIN)
    assert corridor.position_ned_m[1] == pytest.approx((40.0, -20.0, -13.0), abs=0.01)
    assert corridor.beside_m == (0.5, 1.5)
    assert (corridor.above_m, corridor.below_m) == ((0.5, 0.6), (0.2, 1.5))
    assert corridor_of(of_a_mission(), HERE, None).position_ned_m[0] == HERE


def with_roles(**changes):
    """A dry run of two vehicles that stand 20 m apart."""
    one = of_a_mission()
    lead = one["monte_carlo"]["corridor"]
    left = {**lead, "position_ned_m": [[n, e + 20.0, d] for n, e, d in lead["position_ned_m"]]}
    roles = {"lead": {"corridor": lead}, "left": {"corridor": left}}
    return {**one, "together": {"monte_carlo": {"roles": roles}}, **changes}


LEFT = (HERE[0], HERE[1] + 20.0, HERE[2] + 3.0)
"""The start of the second role's vehicle, 3 m lower."""


def test_the_corridor_of_a_role_begins_at_its_own_vehicle():
    corridor = corridor_of(with_roles(), LEFT, ORIGIN, "left")
    assert corridor.position_ned_m[0] == pytest.approx(LEFT, abs=0.01)
    assert corridor.position_ned_m[1] == pytest.approx((40.0, 0.0, -10.0), abs=0.01)
    assert corridor_of(with_roles(), LEFT, None, "left").position_ned_m[0] == pytest.approx(LEFT)


@pytest.mark.parametrize(
    ("dry_run", "here", "role", "expected"),
    [
        (with_roles(), LEFT, "third", "has no corridor of the role 'third'"),
        (with_roles(), HERE, None, "has no corridor of an offboard mission of one vehicle"),
        (of_a_mission(), HERE, "lead", "has no corridor of the role 'lead'"),
        (with_roles(monte_carlo=None), HERE, "lead", "has no corridor of the role 'lead'"),
        (with_roles(), HERE, "left", "began 20 m from the vehicle's position"),
    ],
)
def test_a_dry_run_that_does_not_fit_the_role_is_refused(dry_run, here, role, expected):
    with pytest.raises(Refused, match=expected):
        corridor_of(dry_run, here, ORIGIN, role)


@pytest.mark.parametrize(
    ("dry_run", "here", "expected"),
    [
        (of_a_mission(monte_carlo=None), HERE, "has no corridor"),
        (of_a_mission(kind="waypoint_plan"), HERE, "has no corridor"),
        (of_a_mission(), (90.0, -20.0, 0.0), "began 60 m from the vehicle's position"),
    ],
)
def test_a_dry_run_without_corridor_or_with_another_start_is_refused(dry_run, here, expected):
    with pytest.raises(Refused, match=expected):
        corridor_of(dry_run, here, ORIGIN)


PLAN = read('{"items": [{"kind": "return_home"}]}')
GROUND = (HERE[0] + 1.0, HERE[1] - 1.0, -2.0)


def of_a_plan(**changes):
    """A dry run of a waypoint plan that started 1 m beside `GROUND`."""
    one = of_a_mission()
    flown = [[0.0, 0.0, 0.0], [5.0, 0.0, -8.0], [10.0, 0.0, 0.0]]
    nominal = {
        **one["nominal"], "finished": True, "landed": True, "duration_s": 4.0,
        "path": {"t_s": [0.0, 2.0, 4.0], "position_ned_m": flown},
        "steps": [{"place": "item 1", "title": "Return home", "row": 0, "start_s": 0.0, "end_s": 4.0}],
    }  # fmt: skip
    return {**one, "kind": "waypoint_plan", "nominal": {**nominal, **changes}}


def test_the_path_of_a_plan_begins_at_the_vehicles_height_and_the_dry_runs_position():
    planned, corridor = path_of(of_a_plan(), PLAN, GROUND, ORIGIN)
    assert planned.passes[0].leg.points[1] == pytest.approx((2.0, HERE[0] + 5.0, HERE[1], -10.0), abs=0.01)
    assert corridor.position_ned_m[1] == pytest.approx((HERE[0] + 10.0, HERE[1], -10.0), abs=0.01)
    assert path_of({**of_a_plan(), "monte_carlo": None}, PLAN, GROUND, ORIGIN)[1] is None


@pytest.mark.parametrize(
    ("dry_run", "ground", "expected"),
    [
        (of_a_plan(finished=False), GROUND, "has not flown the whole plan"),
        (of_a_plan(path=None), GROUND, "has not flown the whole plan"),
        (of_a_plan(), (HERE[0] + 6.0, HERE[1], 0.0), "began 6 m from the vehicle's position"),
    ],
)
def test_a_dry_run_that_does_not_fit_the_start_of_a_plan_is_refused(dry_run, ground, expected):
    with pytest.raises(Refused, match=expected):
        path_of(dry_run, PLAN, ground, ORIGIN)
