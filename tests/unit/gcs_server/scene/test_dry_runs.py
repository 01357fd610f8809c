"""A dry run in the 3D view: the position of its vehicle, its corridor, and the time that each view shows."""

import math

import numpy as np
import pytest

from gcs_server.errors import UnknownDryRun
from gcs_server.scene.dry_runs import corridor_edges, corridor_mesh, path_lines, paths_of, pose_at
from gcs_server.scene.proxy import ViewRequest
from gcs_server.scene.scene import Scene
from missions.frames import rotate, yaw_from_q
from tests.unit.gcs_server.scene.scene_fakes import FakeFleet, StillClock, flying_vehicle

SQRT_HALF = math.sqrt(0.5)
Q_EAST = (SQRT_HALF, 0.0, 0.0, SQRT_HALF)
"""q_ned_frd of a level vehicle with heading east."""
RESULT = {
    "nominal": {
        "origin": {"lat_deg": 47.4, "lon_deg": 8.5, "alt_amsl_m": 480.0},
        "path": {
            "t_s": [0.0, 10.0, 20.0],
            "position_ned_m": [(0.0, 0.0, 0.0), (0.0, 0.0, -10.0), (0.0, 40.0, -10.0)],
            "q_ned_frd": [Q_EAST, Q_EAST, Q_EAST],
            "gimbal_rad": [(0.0, 0.0), (-math.pi / 2, 0.0), (0.0, math.pi)],
        },
    },
    "monte_carlo": {
        "corridor": {
            "position_ned_m": [(0.0, 0.0, 0.0), (0.0, 0.0, -10.0), (0.0, 40.0, -10.0)],
            "horizontal_m": {"p95": [1.0, 1.0, 3.0]},
            "vertical_m": {"p5": [-0.5, -0.5, -2.0], "p95": [0.5, 0.5, 1.0]},
        }
    },
    "group": None,
}
RESULT_WITHOUT_PATH = {"nominal": {**RESULT["nominal"], "path": None}, "monte_carlo": None, "group": None}
START_ENU_M = (100.0, 200.0, 5.0)


def path():
    (only_path,) = paths_of(RESULT)
    return only_path


def test_the_position_in_a_dry_run_is_interpolated_and_stays_at_the_ends_of_its_path():
    at_15_s = pose_at(path(), 15.0, START_ENU_M)
    assert at_15_s.position_enu_m == pytest.approx((120.0, 200.0, 15.0))
    assert yaw_from_q(at_15_s.q_enu_flu) == pytest.approx(0.0)
    assert (at_15_s.label, at_15_s.note) == ("dry run · 10.0 m above the start", "00:15")
    assert pose_at(path(), 99.0, START_ENU_M).position_enu_m == pytest.approx((140.0, 200.0, 15.0))
    assert pose_at(path(), 0.0, START_ENU_M).position_enu_m == pytest.approx(START_ENU_M)


@pytest.mark.parametrize(("t_s", "direction_enu"), [(0.0, (0, 1, 0)), (10.0, (0, 0, -1)), (20.0, (0, -1, 0))])
def test_the_gimbal_points_as_in_the_dry_run(t_s, direction_enu):
    pose = pose_at(path(), t_s, START_ENU_M)
    assert pose.q_body_camera is not None
    camera_axis_enu = rotate(pose.q_enu_flu, rotate(pose.q_body_camera, (1.0, 0.0, 0.0)))
    assert camera_axis_enu == pytest.approx(direction_enu, abs=1e-6)


def test_the_corridor_has_the_width_and_height_of_the_simulated_flights():
    corners = path().corridor_enu_m
    assert corners is not None
    np.testing.assert_allclose(corners[2], [(40, 3, 8), (40, -3, 8), (40, -3, 11), (40, 3, 11)])
    mesh = corridor_mesh(path())
    assert mesh is not None
    assert (mesh.vertices.shape, mesh.faces.shape, int(mesh.faces.max())) == ((12, 3), (16, 3), 11)
    assert path_lines(path()).shape == (3, 2, 3)
    lines = corridor_edges(path())
    assert lines is not None
    assert lines.shape == (8, 2, 3)
    np.testing.assert_allclose(lines[4], [(0, 1, 9.5), (40, 3, 8)])


def test_each_role_has_its_own_corridor():
    narrow_result = RESULT["monte_carlo"]
    wide_result = {"corridor": {**narrow_result["corridor"], "horizontal_m": {"p95": [4.0, 4.0, 9.0]}}}
    flights = {"lead": RESULT["nominal"], "left": RESULT["nominal"]}
    group = {"roles": flights, "monte_carlo": {"roles": {"lead": narrow_result, "left": wide_result}}}
    lead_path, left_path = paths_of({**RESULT, "group": group})
    assert (lead_path.role, left_path.role) == ("lead", "left")
    assert lead_path.corridor_enu_m is not None
    assert left_path.corridor_enu_m is not None
    np.testing.assert_allclose(lead_path.corridor_enu_m[2][0], (40, 3, 8))
    np.testing.assert_allclose(left_path.corridor_enu_m[2][0], (40, 9, 8))


def test_a_single_flight_has_no_corridor_and_a_flight_without_samples_has_no_path():
    (single_flight,) = paths_of({**RESULT, "monte_carlo": None})
    assert corridor_mesh(single_flight) is None
    assert corridor_edges(single_flight) is None
    assert paths_of(RESULT_WITHOUT_PATH) == ()


def test_each_of_several_vehicles_has_a_path_labelled_with_its_role():
    flights = {"lead": RESULT["nominal"], "left": RESULT_WITHOUT_PATH["nominal"], "right": RESULT["nominal"]}
    group = {"roles": flights, "monte_carlo": None}
    paths = paths_of({"nominal": RESULT["nominal"], "monte_carlo": None, "group": group})
    assert [each.role for each in paths] == ["lead", "right"]
    assert pose_at(paths[1], 15.0, START_ENU_M).label == "right · 10.0 m above the start"


def dry_run_after_request(scene, **request):
    return scene.set_view("page", ViewRequest.model_validate(request)).dry_run


def test_a_view_keeps_the_shown_time_until_a_new_request():
    requested_ids: list[str] = []

    def find_paths(dry_run: str):
        requested_ids.append(dry_run)
        if dry_run not in ("1", "2"):
            raise UnknownDryRun(f"There is no result of a dry run {dry_run!r}.")
        return paths_of(RESULT if dry_run == "1" else RESULT_WITHOUT_PATH)

    scene = Scene(FakeFleet([flying_vehicle("1")]), StillClock(), dry_runs=find_paths)
    first_dry_run = dry_run_after_request(scene, dry_run={"id": "1", "t_s": 3.0, "follow": True})
    later_dry_run = dry_run_after_request(scene, dry_run={"id": "1", "t_s": 4.0})
    assert (first_dry_run.t_s, first_dry_run.follow, later_dry_run.t_s, later_dry_run.follow) == (
        3.0,
        True,
        4.0,
        False,
    )
    assert first_dry_run.paths is later_dry_run.paths
    assert requested_ids == ["1"]
    assert dry_run_after_request(scene, mode="free") is later_dry_run
    assert dry_run_after_request(scene, dry_run={"id": "1", "t_s": None}).t_s is None
    later_dry_run = dry_run_after_request(scene, dry_run={"id": "1", "t_s": 4.0})
    with pytest.raises(UnknownDryRun):
        dry_run_after_request(scene, dry_run={"id": "9", "t_s": 0.0})
    assert dry_run_after_request(scene, mode="chase") is later_dry_run
    assert dry_run_after_request(scene, dry_run={"id": "2", "t_s": 0.0}) is None
    assert dry_run_after_request(scene, dry_run=None) is None


@pytest.mark.parametrize("t_s", [-1.0, math.nan, math.inf])
def test_an_invalid_time_is_refused(t_s):
    with pytest.raises(ValueError, match="t_s"):
        ViewRequest.model_validate({"dry_run": {"id": "1", "t_s": t_s}})
