"""Ground, obstacles and lidars: rays compared with geometry, collisions, invalid files."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.unit.vehicle_sim.sim_station import DO_SET_MODE, GCS_AND_API_LINKS, Station
from vehicle_sim.simulation import Simulation
from vehicle_sim.world.contact import Contact
from vehicle_sim.world.files import built_in_worlds, load_world, world_from_fields
from vehicle_sim.world.prism import Prism
from vehicle_sim.world.raycast import GROUND, NOTHING, RayCaster
from vehicle_sim.world.terrain import HeightGrid, Hill, Terrain
from vehicle_sim.world.world import Box, Lidars, World, wall
from vehicle_sim.yaml_fields import FileProblem, parse_yaml

pytestmark = pytest.mark.flight

BOX = Box("box", 10.0, 0.0, 2.0, 4.0, 3.0)


def cast(world, origin, direction, range_m=100.0):
    ray = np.array([direction], dtype=float)
    ray /= np.linalg.norm(ray)
    hits = RayCaster(world).cast(np.array([origin], dtype=float), ray, range_m)
    return float(hits.distance_m[0]), int(hits.target[0])


def test_rays_hit_boxes_and_ground_at_the_calculated_distances():
    world = World(boxes=(BOX,))
    assert cast(world, (0, 0, -1), (1, 0, 0)) == (pytest.approx(9.0), 0)
    assert cast(world, (0, 2.1, -1), (1, 0, 0)) == (math.inf, NOTHING), "beside the box"
    assert cast(world, (0, 0, -3.1), (1, 0, 0)) == (math.inf, NOTHING), "above the box"
    assert cast(world, (10, 0, -5), (0, 0, 1)) == (pytest.approx(2.0), 0), "from above"
    assert cast(world, (0, 0, -5), (0, 0, 1)) == (pytest.approx(5.0), GROUND)
    assert cast(world, (0, 0, -3), (3, 0, 4))[0] == pytest.approx(3.75), "at an angle to the ground"
    assert cast(world, (0, 0, -1), (1, 0, 0), range_m=8.9) == (math.inf, NOTHING), "out of range"
    assert cast(world, (10, 0, -1), (0, 1, 0))[0] == 0.0, "from inside the box"


def test_rays_hit_rotated_boxes_and_walls_on_their_faces():
    turned_box = Box("turned", 10.0, 0.0, 2.0, 2.0, 3.0, yaw_ned_rad=math.pi / 4)
    assert cast(World(boxes=(turned_box,)), (0, 0, -1), (1, 0, 0))[0] == pytest.approx(10 - math.sqrt(2))
    thin_wall = wall("fence", (5, -5), (5, 5), height_m=2, thickness_m=0.4)
    assert cast(World(boxes=(thin_wall,)), (0, 3, -1), (1, 0, 0))[0] == pytest.approx(4.8)
    assert cast(World(boxes=(thin_wall,)), (0, 5.1, -1), (1, 0, 0))[0] == math.inf


L_SHAPED = ((10.0, -5.0), (20.0, -5.0), (20.0, 5.0), (15.0, 5.0), (15.0, 0.0), (10.0, 0.0))
"""North, east [m]: the prism has no part at 10 to 15 m north, 0 to 5 m east."""
PRISM = World(prisms=(Prism("l", L_SHAPED, 3.0),))


def test_rays_hit_the_sides_and_the_roof_of_a_prism():
    assert cast(PRISM, (0, -2, -1), (1, 0, 0)) == (pytest.approx(10.0), 0)
    assert cast(PRISM, (0, 2, -1), (1, 0, 0)) == (pytest.approx(15.0), 0), "the open corner"
    assert cast(PRISM, (0, 2, -3.1), (1, 0, 0)) == (math.inf, NOTHING), "above the roof"
    assert cast(PRISM, (18, 2, -5), (0, 0, 1)) == (pytest.approx(2.0), 0), "from above"
    assert cast(PRISM, (12, 2, -5), (0, 0, 1)) == (pytest.approx(5.0), GROUND), "beside the roof"
    assert cast(PRISM, (18, 2, -1), (0, 1, 0)) == (0.0, 0), "from inside"


@given(
    origin=st.tuples(st.floats(0, 30), st.floats(-12, 12), st.floats(-8, -0.1)),
    direction=st.tuples(*[st.integers(-50, 50)] * 3).filter(any),
)
@settings(max_examples=60, deadline=None)
def test_a_rectangular_prism_is_measured_like_a_box(origin, direction):
    corners = ((9.0, -2.0), (11.0, -2.0), (11.0, 2.0), (9.0, 2.0))
    distance_m, hit = cast(World(prisms=(Prism("box", corners, 3.0),)), origin, direction)
    expected_m, expected = cast(World(boxes=(BOX,)), origin, direction)
    assert (distance_m, hit) == (pytest.approx(expected_m), expected)


def test_vehicles_rest_on_prisms_and_are_moved_out_of_their_sides():
    contact = Contact(PRISM, 3)
    positions = np.array([[18.0, 0.0, -3.0], [9.8, -2.0, -1.0], [12.0, 2.5, -1.0]])
    velocity = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    assert contact.support_down_m(positions).tolist() == [-3.0, 0.0, 0.0]
    assert [(hit.row, hit.obstacle) for hit in contact.collide(positions, velocity)] == [(1, "l")]
    assert positions[1] == pytest.approx([9.7, -2.0, -1.0])
    assert velocity[1, 0] < 0.0
    assert contact.collide(positions, velocity) == [], "the crashed vehicle collided again"


@settings(max_examples=60, deadline=None)
@given(
    st.floats(-40, 40),
    st.floats(-40, 40),
    st.floats(0.5, 30),
    st.floats(-1, 1),
    st.floats(-1, 1),
    st.floats(0.2, 1),
)
def test_rays_end_on_the_terrain(north, east, above, dn, de, dd):
    terrain = Terrain((Hill(10, 0, 8, 30),), HeightGrid(-20, -20, 20, np.array([[0.0, 2], [1, 3], [0, 4]])))
    start = np.array([north, east, -(float(terrain.alt_home_m(np.array(north), np.array(east))) + above)])
    distance, hit = cast(World(terrain=terrain), start, (dn, de, dd), range_m=300.0)
    assert hit == GROUND
    ray = np.array([dn, de, dd]) / np.linalg.norm((dn, de, dd))
    end = start + distance * ray
    assert -end[2] == pytest.approx(float(terrain.alt_home_m(end[0], end[1])), abs=0.05)


def test_vehicles_rest_on_the_terrain_and_on_roofs():
    world = World(terrain=Terrain((Hill(0, 0, 10, 30),)), boxes=(Box("roof", 0, 50, 4, 4, 3),))
    sim = Simulation(3, world=world, start_ned_m=np.array([[0, 0, 0.0], [0, 50, -8], [15, 0, 0]]))
    for _ in range(1000):
        sim.step()
    assert sim.truth.position_ned_m[:, 2] == pytest.approx([-10.0, -3.0, -5.0], abs=1e-6)
    assert sim.truth.on_ground.all()
    assert not sim.take_collisions()


def test_distant_obstacles_do_not_change_a_flight():
    without_obstacle, with_obstacle = (
        Simulation(seed=2),
        Simulation(seed=2, world=World(boxes=(Box("far", 900, 900, 1, 1, 1),))),
    )
    for sim in (without_obstacle, with_obstacle):
        sim.setpoints.armed[:] = True
        sim.setpoints.level[:] = 4  # ControlLevel.ATTITUDE
        sim.setpoints.thrust[:] = 0.6
        for _ in range(400):
            sim.step()
    assert np.array_equal(without_obstacle.truth.position_ned_m, with_obstacle.truth.position_ned_m)


@pytest.mark.story
def test_the_box_is_measured_and_a_collision_with_it_stops_the_motors():
    station = Station(world=load_world("obstacle-box"), links=GCS_AND_API_LINKS)
    station.take_off_and_hover(2.5)
    vehicle_north_m = float(station.sim.simulation.truth.position_ned_m[0, 0])
    forward_message = [m for m in station.received("DISTANCE_SENSOR", via="api") if m.orientation == 0][-1]
    down_message = [m for m in station.received("DISTANCE_SENSOR", via="api") if m.orientation == 25][-1]
    # The box is 1.5 m long, with its centre at 5 m.
    assert forward_message.current_distance == pytest.approx((5 - 0.75 - vehicle_north_m) * 100, abs=40)
    assert down_message.current_distance == pytest.approx(station.height_m * 100, abs=20)
    around_message = station.received("OBSTACLE_DISTANCE", via="api")[-1]
    assert abs(around_message.distances[0] - forward_message.current_distance) < 15
    assert around_message.distances[36] == around_message.max_distance + 1 == 2001, "an obstacle is behind"
    flight_start_s = station.now_s

    def send_velocity_north():
        station.send("SET_POSITION_TARGET_LOCAL_NED", target_system=1, target_component=1, coordinate_frame=1,
                     type_mask=0b110111000111, vx=2.0)  # fmt: skip

    station.run(1.0, send_velocity_north)
    station.command(DO_SET_MODE, 1, 6)
    station.run_until(lambda: not station.armed, 15, send_velocity_north)
    assert "Collision with the obstacle box: motors stopped" in station.status_texts(flight_start_s)
    station.run(4.0)
    position = station.sim.simulation.truth.position_ned_m[0]
    assert station.height_m < 0.1, "the vehicle did not fall"
    assert position[0] < 5 - 0.75, "not in front of the box"


def test_without_a_world_there_is_one_lidar_that_points_down():
    station = Station(links=GCS_AND_API_LINKS)
    station.take_off_and_hover(8.0)
    messages = station.received("DISTANCE_SENSOR", via="api")
    assert {m.orientation for m in messages} == {25}
    assert messages[-1].current_distance == pytest.approx(station.height_m * 100, abs=15)
    assert not station.received("OBSTACLE_DISTANCE", via="api")


def test_a_flight_into_a_hill_is_a_collision():
    world = World(terrain=Terrain((Hill(30, 0, 20, 20),)))
    sim = Simulation(world=world, start_ned_m=np.array([[6.0, 0, -8]]), sensor_noise=False)
    sim.truth.velocity_ned_m_s[:] = (15.0, 0.0, -2.0)
    collisions = []
    for _ in range(1000):
        sim.step()
        if collisions := sim.take_collisions():
            break
    assert [c.obstacle for c in collisions] == ["the ground"]
    assert not sim.motor_health.any()


def test_every_shipped_world_loads():
    assert {"obstacle-box", "hills", "yard"} <= set(built_in_worlds())
    for name in built_in_worlds():
        assert not load_world(name).empty


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "empty"),
        ("name: [", "line 1: not YAML"),
        ("- a", "line 1: the file must contain `name: value` lines"),
        ("boxes: []", "lacks name; give a text"),
        ("name: x\nboxes:\n  - {north_m: 1, east_m: 2, length_m: 3, width_m: tall, height_m: 2}",
         "line 3: boxes[0].width_m is 'tall'; give a number from 0.01 to 5000"),
        ("name: x\nboxes:\n  - {north_m: 1, east_m: 2, length_m: 3, width_m: 1}", "boxes[0] lacks height_m"),
        ("name: x\nboxes:\n  - {north_m: .nan, east_m: 2}", "boxes[0].north_m is nan"),
        ("name: x\nbox: []", "line 2: box is not known; did you mean boxes?"),
        ("name: x\nname: y", "line 2: name appears twice"),
        ("name: x\nwalls: [{from_ne_m: [1], to_ne_m: [1, 2], height_m: 1}]", "from_ne_m is [1]; give [north"),
        ("name: x\nwalls: [{from_ne_m: [1, 2], to_ne_m: [1, 2], height_m: 1}]", "also the start of the wall"),
        ("name: x\nlidars: {around: maybe}", "lidars.around is 'maybe'; give true or false"),
        ("name: x\nterrain: {grid: {north_m: 0, east_m: 0, spacing_m: 5, heights_m: [[1, 2], [3]]}}",
         "terrain.grid.heights_m must be at least two lists"),
        ("name: x\nterrain: {hills: 5}", "terrain.hills must be a list"),
        ("name: !!python/name:os.system x", "contains a value that is neither text nor number"),
    ],
)  # fmt: skip
def test_the_error_about_an_invalid_file_names_field_and_line(text, expected):
    with pytest.raises(FileProblem) as problem:
        world_from_fields(parse_yaml(text, "my.yaml"))
    assert expected in str(problem.value)
    assert str(problem.value).startswith("my.yaml")


def test_a_missing_file_names_the_shipped_worlds():
    with pytest.raises(FileProblem, match="obstacle-box"):
        load_world("no-such-world")


def test_the_lidars_of_several_vehicles_are_measured_together():
    world = World(boxes=(BOX,), lidars=Lidars(forward=True, around=True, range_m=30))
    starts_ned_m = np.array([[0.0, 0, -1], [4.0, 0, -1], [0.0, 9, -1]])
    sim = Simulation(3, world=world, start_ned_m=starts_ned_m)
    assert [sim.distance_forward_m(i) for i in range(3)] == pytest.approx([9.0, 5.0, math.inf])
    sectors = np.array([sim.distances_around_m(i) for i in range(3)])
    assert sectors.shape == (3, 72)
    assert np.isfinite(sectors[0]).sum() >= 5
