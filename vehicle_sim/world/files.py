"""Worlds from YAML files, and the built-in worlds of the simulator (`vehicle_sim/worlds/`).

    name: obstacle box
    terrain:
      hills: [{north_m: 60, east_m: 20, height_m: 12, radius_m: 40}]
      grid: {north_m: -50, east_m: -50, spacing_m: 50, heights_m: [[0, 0], [4, 6]]}
    boxes: [{name: house, north_m: 10, east_m: 0, length_m: 4, width_m: 6, height_m: 3}]
    walls: [{name: fence, from_ne_m: [5, -5], to_ne_m: [5, 5], height_m: 2}]
    lidars: {forward: true, around: true, range_m: 20}

North and east are distances from home. The `heights_m` of a grid are altitudes above home, a hill adds its
`height_m` to the ground, and the `height_m` of boxes and walls is above their base. Boxes may have
`yaw_ned_deg`; boxes and walls may have `base_alt_home_m`.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from vehicle_sim.world.terrain import HeightGrid, Hill, Terrain
from vehicle_sim.world.world import Box, Lidars, World, wall
from vehicle_sim.yaml_fields import Fields, FileProblem, read_yaml

WORLDS_FOLDER = Path(__file__).resolve().parent.parent / "worlds"
MAX_COORDINATE_M = 20_000.0
MAX_OBSTACLES = 500


def built_in_worlds() -> tuple[str, ...]:
    """Names of the built-in worlds."""
    return tuple(sorted(path.stem for path in WORLDS_FOLDER.glob("*.yaml")))


def load_world(name_or_path: str) -> World:
    """Loads a built-in world by name, or a world from a file.

    Raises:
        FileProblem: the file does not exist or is invalid; the text names line, field and fix.
    """
    if name_or_path in built_in_worlds():
        return world_from_fields(read_yaml(WORLDS_FOLDER / f"{name_or_path}.yaml"))
    path = Path(name_or_path)
    if not path.exists():
        names = ", ".join(built_in_worlds())
        raise FileProblem(f"{name_or_path}: no such file or built-in world; built-in worlds: {names}")
    return world_from_fields(read_yaml(path))


def world_from_fields(fields: Fields) -> World:
    """Builds the world of a parsed file.

    Raises:
        FileProblem: a field is missing, unknown or invalid.
    """
    name = fields.text("name")
    terrain = _terrain(fields.mapping("terrain"))
    boxes = [_box(entry) for entry in fields.items("boxes")]
    boxes += [_wall(entry) for entry in fields.items("walls")]
    lidars = _lidars(fields.mapping("lidars"))
    fields.finish()
    if len(boxes) > MAX_OBSTACLES:
        raise fields.problem(None, f"has {len(boxes)} obstacles; the maximum is {MAX_OBSTACLES}")
    return World(name, terrain, tuple(boxes), lidars)


def _terrain(fields: Fields | None) -> Terrain:
    if fields is None:
        return Terrain()
    hills = tuple(_hill(entry) for entry in fields.items("hills"))
    grid = _grid(fields.mapping("grid"))
    fields.finish()
    return Terrain(hills, grid)


def _position(fields: Fields) -> tuple[float, float]:
    return (
        fields.number("north_m", low=-MAX_COORDINATE_M, high=MAX_COORDINATE_M),
        fields.number("east_m", low=-MAX_COORDINATE_M, high=MAX_COORDINATE_M),
    )


def _hill(fields: Fields) -> Hill:
    north_m, east_m = _position(fields)
    hill = Hill(
        north_m,
        east_m,
        fields.number("height_m", low=-500, high=2000),
        fields.number("radius_m", low=1, high=20_000),
    )
    fields.finish()
    return hill


def _grid(fields: Fields | None) -> HeightGrid | None:
    if fields is None:
        return None
    north_m, east_m = _position(fields)
    spacing_m = fields.number("spacing_m", low=0.1, high=5000)
    grid = HeightGrid(north_m, east_m, spacing_m, np.array(fields.rows("heights_m")))
    fields.finish()
    return grid


def _box(fields: Fields) -> Box:
    north_m, east_m = _position(fields)
    box = Box(
        fields.text("name", "a box"),
        north_m,
        east_m,
        fields.number("length_m", low=0.01, high=5000),
        fields.number("width_m", low=0.01, high=5000),
        fields.number("height_m", low=0.01, high=2000),
        fields.number("base_alt_home_m", 0.0, low=-500, high=2000),
        math.radians(fields.number("yaw_ned_deg", 0.0, low=-360, high=360)),
    )
    fields.finish()
    return box


def _wall(fields: Fields) -> Box:
    start = fields.numbers("from_ne_m", 2, "[north, east] in metres")
    end = fields.numbers("to_ne_m", 2, "[north, east] in metres")
    if start == end:
        raise fields.problem("to_ne_m", "is also the start of the wall; give another position")
    box = wall(
        fields.text("name", "a wall"),
        (start[0], start[1]),
        (end[0], end[1]),
        height_m=fields.number("height_m", low=0.01, high=2000),
        thickness_m=fields.number("thickness_m", 0.2, low=0.01, high=100),
        base_alt_home_m=fields.number("base_alt_home_m", 0.0, low=-500, high=2000),
    )
    fields.finish()
    return box


def _lidars(fields: Fields | None) -> Lidars:
    if fields is None:
        return Lidars()
    lidars = Lidars(
        forward=fields.flag("forward", False),
        around=fields.flag("around", False),
        range_m=fields.number("range_m", 20.0, low=0.5, high=300),
    )
    fields.finish()
    return lidars
