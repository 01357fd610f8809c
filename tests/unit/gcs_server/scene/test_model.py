"""What the 3D view draws: models, texts, trails, smoothed poses, camera views, colours."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gcs_server.scene import model, shapes
from gcs_server.scene.palette import PALETTES, tone_corrected
from gcs_server.scene.placement import Placement
from gcs_server.scene.pose import pose_of
from gcs_server.scene.smoothing import MAX_POINTS, Smoother, Trail
from gcs_server.scene.views import CAMERAS, WorldPose, in_world, world_pose
from missions.frames import IDENTITY, q_from_yaw, rotate
from tests.unit.gcs_server.scene.scene_fakes import flying_vehicle

SOLIDS = {
    "shell": model.shell(),
    "dark parts": model.dark_parts(),
    "camera": model.camera_ball(),
    "tube": model.tube((0, 0, 0), (0.3, 0.2, 1.0), 0.1, 0.05),
    "box": model.rounded_box((0.2, 0.1, 0.05)),
}

HEADING_NORTH_RAD = math.pi / 2
"""Heading north, as yaw in ENU: anticlockwise from east."""


@pytest.mark.parametrize("name", SOLIDS)
def test_the_faces_of_solids_point_outwards(name):
    mesh = SOLIDS[name]
    a, b, c = (mesh.vertices[mesh.faces[:, i]].astype(float) for i in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
    assert mesh.faces.max() < len(mesh.vertices)
    assert volume > 0


def test_rotors_have_px4s_numbering():
    front_right, rear_left, front_left, rear_right = model.ROTORS_FLU_M
    assert front_right[0] > 0 > front_right[1]
    assert rear_left[0] < 0 < rear_left[1]
    assert min(front_left[:2]) > 0 > max(rear_right[:2])
    # Diagonal rotors turn in the same direction, neighbours in opposite directions; motor 1 turns
    # anticlockwise.
    assert model.ROTOR_SPINS == (1, 1, -1, -1)


def test_rotors_do_not_touch():
    assert math.dist(model.ROTORS_FLU_M[0], model.ROTORS_FLU_M[2]) > 2 * model.ROTOR_RADIUS_M


@pytest.mark.parametrize(
    "direction", [(2.0, 0, 0), (0, 3.0, 0), (0, 0, -1.0), (-1.0, 0, 0), (1.0, -2.0, 0.5)]
)
def test_a_line_is_turned_along_its_direction(direction):
    turned_axis = rotate(model.q_along(direction), (1.0, 0.0, 0.0))
    length = math.dist(direction, (0, 0, 0))
    assert turned_axis == pytest.approx(tuple(c / length for c in direction), abs=1e-9)


def test_a_line_of_zero_length_is_not_turned():
    assert model.q_along((0.0, 0.0, 0.0)) == IDENTITY


def test_text_is_centred_and_has_the_given_height():
    segments = shapes.text_segments("10 m", height_m=2.0, at_m=(5.0, 7.0, 0.0))
    low, high = segments.reshape(-1, 3).min(axis=0), segments.reshape(-1, 3).max(axis=0)
    assert (low + high)[0] / 2 == pytest.approx(5.0, abs=0.2)
    assert high[1] - low[1] == pytest.approx(2.0)


@pytest.mark.parametrize("step_m", [10.0, 100.0, 1000.0])
def test_every_grid_scale_has_a_label(step_m):
    assert np.isfinite(shapes.scale_marks(step_m)).all()


def test_the_number_of_points_of_a_trail_is_limited_and_its_ends_are_kept():
    trail = Trail()
    for i in range(20_000):
        trail.add((i * 0.3, 0.0, 5.0))
    assert len(trail.sealed) <= MAX_POINTS + Trail.RECENT_POINTS
    assert len(trail.recent) < Trail.RECENT_POINTS
    assert trail.sealed[0] == (0.0, 0.0, 5.0)
    assert trail.sealed[-1] == trail.recent[0] or not trail.recent
    assert sorted(trail.sealed) == trail.sealed


def test_hovering_adds_no_points_to_a_trail():
    trail = Trail()
    was_added = [trail.add((math.sin(i) * 0.05, math.cos(i) * 0.05, 10.0)) for i in range(500)]
    assert sum(was_added) == 1


def test_a_position_jump_starts_a_new_trail_and_nan_is_not_drawn():
    trail = Trail()
    trail.add((0.0, 0.0, 0.0))
    assert not trail.add((math.nan, 0.0, 0.0))
    trail.add((1000.0, 0.0, 0.0))
    assert trail.recent == [(1000.0, 0.0, 0.0)]


def pose():
    vehicle = flying_vehicle()
    return pose_of(vehicle, Placement().place(vehicle), None, 0.0)


def test_the_drawn_position_converges_to_the_vehicles_position():
    smoother, measured_pose = Smoother(), pose()
    smoother.step(measured_pose, 0.03)
    moved_pose = replace(measured_pose, position_enu_m=(1.0, 0.0, 10.0))
    first_step = smoother.step(moved_pose, 0.03)
    assert 0.0 < first_step.position_enu_m[0] < 1.0
    for _ in range(60):
        smoother.step(moved_pose, 0.03)
    assert smoother.pose.position_enu_m == moved_pose.position_enu_m


def test_a_position_jump_is_not_smoothed():
    smoother, measured_pose = Smoother(), pose()
    smoother.step(measured_pose, 0.03)
    assert (
        smoother.step(replace(measured_pose, position_enu_m=(100.0, 0.0, 0.0)), 0.03).position_enu_m[0]
        == 100.0
    )


def test_rotors_turn_in_their_directions_and_stop_when_disarmed():
    smoother, measured_pose = Smoother(), pose()
    old_angles = smoother.rotor_angles_rad
    smoother.step(measured_pose, 0.02)
    turns_rad = [
        math.remainder(b - a, 2 * math.pi) for a, b in zip(old_angles, smoother.rotor_angles_rad, strict=True)
    ]
    assert [math.copysign(1, t) for t in turns_rad] == list(model.ROTOR_SPINS)
    stopped_angles = smoother.rotor_angles_rad
    smoother.step(replace(measured_pose, motors=(0.0, 0.0, 0.0, 0.0)), 0.02)
    assert smoother.rotor_angles_rad == stopped_angles


def test_the_heading_of_the_chase_view_turns_smoothly_and_in_the_shorter_direction():
    smoother = Smoother()

    def step(yaw_enu_rad: float, dt_s: float) -> float:
        smoother.step(replace(pose(), q_enu_flu=q_from_yaw(yaw_enu_rad)), dt_s)
        return smoother.heading_enu_rad

    assert step(3.1, 0.03) == pytest.approx(3.1)
    heading_rad = step(-3.1, 0.03)
    assert 3.1 < heading_rad < math.pi  # over π, not back through 0
    for _ in range(100):
        heading_rad = step(-3.1, 0.03)
    assert heading_rad == pytest.approx(-3.1, abs=1e-3)


@pytest.mark.parametrize("mode", ["chase", "top"])
def test_chase_and_top_views_keep_the_vehicle_in_the_middle(mode):
    measured_pose = pose()
    world = world_pose(mode, measured_pose, HEADING_NORTH_RAD)
    assert in_world(world, (0.0, 0.0, 0.0)) == pytest.approx(measured_pose.position_enu_m, abs=1e-9)


def test_the_chase_view_points_along_the_heading():
    measured_pose = pose()  # heading north
    point_ahead = in_world(world_pose("chase", measured_pose, HEADING_NORTH_RAD), (5.0, 0.0, 0.0))
    assert point_ahead == pytest.approx((0.0, 5.0, 10.0), abs=1e-6)
    camera_position = in_world(
        world_pose("chase", measured_pose, HEADING_NORTH_RAD), CAMERAS["chase"].position_m
    )
    assert camera_position[1] < 0


def test_the_gimbal_view_points_along_the_camera_axis():
    measured_pose = pose()  # camera 0.5 rad down
    world = world_pose("gimbal", measured_pose, 0.0)
    camera_position, point_ahead = in_world(world, (0.0, 0.0, 0.0)), in_world(world, (1.0, 0.0, 0.0))
    assert point_ahead[2] - camera_position[2] == pytest.approx(-math.sin(0.5), abs=1e-9)
    assert point_ahead[1] - camera_position[1] == pytest.approx(math.cos(0.5), abs=1e-9)


def test_the_free_view_does_not_move_the_scene():
    assert world_pose("free", pose(), 1.0) == WorldPose()
    assert world_pose("chase", None, 1.0) == WorldPose()


def test_vehicles_have_the_colours_of_the_page(reference_data):
    tokens = (reference_data / "design" / "tokens.css").read_text()
    dark, light = tokens.split('[data-theme="light"]')
    for css, palette in ((dark, PALETTES["dark"]), (light, PALETTES["light"])):
        for name, colour in zip(("actual", "id-2", "id-3", "id-4"), palette.vehicle_colours, strict=True):
            assert f"--{name}: {colour};" in css
        assert f"--target: {palette.target};" in css
        assert f"--map: {palette.ground};" in css
    assert PALETTES["dark"].vehicle_colour(4) == PALETTES["dark"].vehicle_colour(0)


def test_colours_of_the_light_theme_are_shown_unchanged():
    assert tone_corrected("#00788a", PALETTES["light"]) == (0, 0x78, 0x8A)
    assert max(tone_corrected("#35d6e6", PALETTES["dark"])) > 150
