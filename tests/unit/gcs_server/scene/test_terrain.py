"""The ground in the 3D view: its height beside home, its shape, what a ray meets, and when it is read."""

import asyncio
from types import SimpleNamespace

import numpy as np
import pytest

from gcs_server.errors import Refused
from gcs_server.scene.terrain import Terrain, TerrainShape
from gcs_server.scene.terrain_watch import SceneGround
from gcs_server.vehicle.samples import GlobalPosition, Home
from missions.frames import rotate
from missions.geodesy import LocalOrigin
from missions.terrain.relief import Relief, axes_deg

HOME = (47.4, 8.5, 500.0)


def relief(altitude):
    """The ground as a function of metres north and east of home."""
    lats, lons = axes_deg(*HOME[:2])
    all_lons, all_lats = np.meshgrid(lons, lats)
    north_m, east_m = (
        (all_lats - HOME[0]) * 111_195,
        (all_lons - HOME[1]) * 111_195 * np.cos(np.radians(HOME[0])),
    )
    return Relief(*HOME[:2], altitude(north_m, east_m).astype(np.float32))


def shape(altitude, home=HOME):
    return TerrainShape(Terrain.at_home(relief(altitude), home), HOME)


def test_ground_that_nearly_agrees_with_home_passes_through_it():
    ground = shape(lambda north, east: 493.0 + 0.1 * east + 0 * north)
    assert ground.terrain.shift_m == pytest.approx(7.0, abs=0.01)
    assert ground.terrain.note == ""
    assert ground.z_at(0.0, 0.0) == pytest.approx(0.0, abs=0.01)
    assert ground.z_at(200.0, 50.0) == pytest.approx(20.0, abs=0.2)


@pytest.mark.parametrize(("ground_m", "text"), [(478.0, "22 m above"), (515.0, "15 m below")])
def test_ground_that_does_not_agree_stays_at_its_altitude_and_a_text_says_so(ground_m, text):
    ground = shape(lambda north, east: ground_m + 0 * north)
    assert ground.z_at(0.0, 0.0) == pytest.approx(ground_m - HOME[2], abs=0.01)
    assert f"home is {text} the ground" in ground.terrain.note


def test_without_a_home_the_ground_is_at_its_altitude():
    terrain = Terrain.at_home(relief(lambda north, east: 493.0 + 0 * north), None)
    assert (terrain.shift_m, terrain.note) == (0.0, "")


def test_unknown_ground_has_no_triangles_and_no_height():
    ground = shape(lambda north, east: np.where(east > 300.0, np.nan, 500.0 + 0 * north))
    mesh = ground.mesh()
    assert mesh.vertices[mesh.faces].max(axis=(0, 1))[0] < 301.0
    assert np.isfinite(mesh.vertices).all()
    assert len(mesh.faces) <= 80_000
    assert ground.z_at(400.0, 0.0) is None
    assert np.isfinite(ground.lines(100.0, 400.0)).all()
    assert np.isfinite(ground.normals()).all()
    assert ground.colours((0, 0, 0), (255, 255, 255)).shape == (len(mesh.vertices), 3)


def test_a_vertex_stands_where_a_vehicle_would():
    """The mesh and the vehicles use one conversion, so that a vehicle on a hill stands on it."""
    ground = shape(lambda north, east: 500.0 + 40.0 * np.sin(north / 300.0) + 0 * east)
    lat_deg, lon_deg, _ = LocalOrigin(*HOME).to_geodetic((700.0, -400.0, 0.0))
    amsl_m = ground.terrain.relief.altitude_amsl_m(lat_deg, lon_deg)
    assert ground.z_at(-400.0, 700.0) == pytest.approx(amsl_m - HOME[2], abs=0.3)


def test_a_ray_meets_the_slope_before_the_level_of_home():
    ground = shape(lambda north, east: 500.0 + 0.5 * np.maximum(0.0, north))
    hit = ground.hit((0.0, 0.0, 50.0), (0.0, 0.8, -0.6), 5000.0)
    assert hit == pytest.approx((0.0, 40.0, 20.0), abs=0.5)
    assert ground.hit((0.0, 0.0, 50.0), (0.0, -0.6, 0.8), 5000.0) is None
    assert ground.hit((0.0, -2000.0, 50.0), (0.0, -0.999, -0.02), 5000.0) is None, "beyond the known ground"


def test_marks_lie_on_the_slope():
    ground = shape(lambda north, east: 500.0 + 0.3 * north - 0.2 * east)
    up = rotate(ground.tilt_at(50.0, 20.0), (0.0, 0.0, 1.0))
    assert up[0] / up[2] == pytest.approx(0.2, abs=0.01)
    assert up[1] / up[2] == pytest.approx(-0.3, abs=0.01)
    assert ground.tilt_at(1e5, 0.0) == pytest.approx((1.0, 0.0, 0.0, 0.0))


class Vehicle:
    def __init__(self, id, lat_deg, home=HOME):
        self.id = id
        values = {"global_position": GlobalPosition(lat_deg, HOME[1], 510.0, 10.0, (0.0, 0.0, 0.0), None)}
        if home is not None:
            values["home"] = Home(*home, None)
        self._values = values

    def topic(self, name):
        value = self._values.get(name)
        return None if value is None else SimpleNamespace(value=value)


class Reader:
    """Elevation files that change, and how often they are read."""

    def __init__(self):
        self.files, self.reads, self.error = ("a",), [], None
        self.ground = SceneGround(self.list, self.read)

    async def list(self):
        return self.files

    async def read(self, lat_deg, lon_deg):
        self.reads.append(lat_deg)
        if self.error is not None:
            raise self.error
        return relief(lambda north, east: 495.0 + 0 * north)

    def around(self, *vehicles, followed=frozenset()):
        fleet = SimpleNamespace(all=lambda: list(vehicles))
        return asyncio.run(self.ground.around(fleet, followed))


def test_the_ground_is_read_once_for_all_views_and_again_when_the_vehicle_is_far():
    reader = Reader()
    first = reader.around(Vehicle("1", 47.4), Vehicle("2", 47.5))
    assert first.shift_m == pytest.approx(5.0, abs=0.01)
    assert reader.around(Vehicle("1", 47.41)) is first
    assert reader.reads == [47.4]
    assert reader.around(Vehicle("1", 47.4), Vehicle("2", 47.5), followed={"2"}) is not first
    assert reader.reads == [47.4, 47.5]


def test_a_changed_file_is_read_and_a_moved_home_only_moves_the_ground():
    reader = Reader()
    first = reader.around(Vehicle("1", 47.4))
    moved = reader.around(Vehicle("1", 47.4, (47.4, 8.5, 503.0)))
    assert (moved.shift_m, first.shift_m) == (pytest.approx(8.0, abs=0.01), pytest.approx(5.0, abs=0.01))
    assert reader.reads == [47.4]
    reader.files = ("a", "b")
    assert reader.around(Vehicle("1", 47.4)) is not moved
    assert len(reader.reads) == 2
    reader.files = ()
    assert reader.around(Vehicle("1", 47.4)) is None


def test_files_that_cannot_be_read_leave_the_level_grid_and_are_not_read_again_and_again():
    reader = Reader()
    reader.error = Refused("The task took too much memory.")
    assert reader.around(Vehicle("1", 47.4)) is None
    assert reader.around(Vehicle("1", 47.4)) is None
    assert len(reader.reads) == 1
    assert reader.around() is None, "without a vehicle"
