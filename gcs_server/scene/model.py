"""The shapes of the scene as plain arrays: computed once, sent once to each view.

All shapes are in the body frame FLU [m]: x forward, y left, z up. The vehicle is drawn at about twice the
size of a 500 mm quadrotor, so that it stays recognisable from a chase camera in a small inset.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from missions.frames import Quaternion, Vector3

Points = NDArray[np.float32]
"""(N, 3) vertices or (N, 2, 3) line segments."""
Faces = NDArray[np.uint32]
"""(M, 3) indices."""

ARM_M = 0.46
ROTOR_RADIUS_M = 0.27
ROTOR_Z_M = 0.10
GIMBAL_POSITION_M: Vector3 = (0.17, 0.0, -0.115)
FRUSTUM_HALF_WIDTH = 0.52
FRUSTUM_HALF_HEIGHT = 0.32
"""Tangents of half the camera's field of view, a common 55° × 36°."""

ROTORS_FLU_M: tuple[Vector3, ...] = tuple(
    (sx * ARM_M * math.sqrt(0.5), sy * ARM_M * math.sqrt(0.5), ROTOR_Z_M)
    for sx, sy in ((1, -1), (-1, 1), (1, 1), (-1, -1))
)
"""Rotor positions in the order of PX4's quad X: front right, rear left, front left, rear right."""
ROTOR_SPINS: tuple[int, ...] = (1, 1, -1, -1)
"""Direction of rotation seen from above; 1 is anticlockwise."""


@dataclass(frozen=True, slots=True)
class Mesh:
    """Triangles."""

    vertices: Points
    faces: Faces


def join_meshes(*meshes: Mesh) -> Mesh:
    """Joins meshes of one colour into one mesh."""
    offsets = np.cumsum([0, *(len(m.vertices) for m in meshes[:-1])])
    faces = [m.faces + np.uint32(offset) for m, offset in zip(meshes, offsets, strict=True)]
    return Mesh(np.concatenate([m.vertices for m in meshes]), np.concatenate(faces).astype(np.uint32))


def move_mesh(mesh: Mesh, offset_m: Vector3) -> Mesh:
    """The mesh, moved by a vector."""
    return Mesh(mesh.vertices + np.asarray(offset_m, np.float32), mesh.faces)


def rounded_box(half_m: Vector3, *, roundness: float = 0.45, rings: int = 18, sides: int = 28) -> Mesh:
    """A superellipsoid: a box with rounded edges (`roundness` 1 is an ellipsoid, 0 a box)."""
    v = np.linspace(-math.pi / 2, math.pi / 2, rings + 1)[:, None]
    u = np.linspace(-math.pi, math.pi, sides, endpoint=False)[None, :]

    def power(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.sign(x) * np.abs(x) ** roundness

    x = power(np.cos(v)) * power(np.cos(u))
    y = power(np.cos(v)) * power(np.sin(u))
    z = power(np.sin(v)) * np.ones_like(u)
    vertices = (np.stack([x, y, z], axis=-1) * np.asarray(half_m)).reshape(-1, 3).astype(np.float32)
    return Mesh(vertices, _grid_faces(rings, sides))


def tube(
    start_m: Vector3, end_m: Vector3, radius_start_m: float, radius_end_m: float, sides: int = 16
) -> Mesh:
    """A tapered, capped cylinder between two points."""
    a, b = np.asarray(start_m, float), np.asarray(end_m, float)
    axis = (b - a) / np.linalg.norm(b - a)
    helper = np.array([0.0, 0.0, 1.0]) if abs(axis[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    side = np.cross(helper, axis)
    side /= np.linalg.norm(side)
    up = np.cross(axis, side)
    angle = np.linspace(0, 2 * math.pi, sides, endpoint=False)[:, None]
    circle = np.cos(angle) * side + np.sin(angle) * up
    ring_a, ring_b = a + circle * radius_start_m, b + circle * radius_end_m
    # The caps have separate vertices, so that the edge is shaded sharply.
    vertices = np.concatenate([ring_a, ring_b, [a], ring_a, [b], ring_b]).astype(np.float32)
    faces: list[tuple[int, int, int]] = []
    cap_a, cap_b = 2 * sides, 3 * sides + 1
    for i in range(sides):
        j = (i + 1) % sides
        faces += [(i, j, sides + i), (j, sides + j, sides + i)]
        faces += [(cap_a, cap_a + 1 + j, cap_a + 1 + i), (cap_b, cap_b + 1 + i, cap_b + 1 + j)]
    return Mesh(vertices, np.asarray(faces, np.uint32))


def disc(radius_m: float, sides: int = 40) -> Mesh:
    """A flat circle at z 0."""
    angle = np.linspace(0, 2 * math.pi, sides, endpoint=False)
    rim = np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], axis=1) * radius_m
    faces = [(0, 1 + i, 1 + (i + 1) % sides) for i in range(sides)]
    return Mesh(np.concatenate([np.zeros((1, 3)), rim]).astype(np.float32), np.asarray(faces, np.uint32))


def ring_segments(radius_m: float, centre_m: Vector3 = (0.0, 0.0, 0.0), sides: int = 40) -> Points:
    """A circle as (sides, 2, 3) line segments."""
    angle = np.linspace(0, 2 * math.pi, sides + 1)
    rim = np.stack([np.cos(angle), np.sin(angle), np.zeros(sides + 1)], axis=1) * radius_m + np.asarray(
        centre_m
    )
    return np.stack([rim[:-1], rim[1:]], axis=1).astype(np.float32)


def shell() -> Mesh:
    """Body and arms."""
    body = move_mesh(rounded_box((0.20, 0.125, 0.062)), (0.0, 0.0, 0.02))
    arms = [
        tube((x * 0.25, y * 0.25, 0.025), (x, y, ROTOR_Z_M - 0.055), 0.034, 0.022) for x, y, _ in ROTORS_FLU_M
    ]
    return join_meshes(body, *arms)


def dark_parts() -> Mesh:
    """Motors, landing gear and the gimbal's mount."""
    motors = [
        tube((x, y, ROTOR_Z_M - 0.075), (x, y, ROTOR_Z_M - 0.012), 0.042, 0.038) for x, y, _ in ROTORS_FLU_M
    ]
    legs = [
        tube((sx * 0.10, sy * 0.09, -0.02), (sx * 0.13, sy * 0.19, -0.215), 0.012, 0.010)
        for sx in (1, -1)
        for sy in (1, -1)
    ]
    skids = [tube((0.20, sy * 0.19, -0.22), (-0.20, sy * 0.19, -0.22), 0.012, 0.012) for sy in (1, -1)]
    x, y, z = GIMBAL_POSITION_M
    mount = tube((x - 0.02, y, -0.02), (x - 0.02, y, z + 0.02), 0.022, 0.022)
    return join_meshes(*motors, *legs, *skids, mount)


def front_mark() -> Mesh:
    """Marks of the front: an arrow on the top, and a ring around each front arm, in the vehicle's colour."""
    z = 0.0845
    arrow = Mesh(
        np.asarray([(0.165, 0, z), (0.02, 0.075, z), (0.055, 0, z), (0.02, -0.075, z)], np.float32),
        np.asarray([(0, 1, 2), (0, 2, 3)], np.uint32),
    )
    rings: list[Mesh] = []
    for x, y, _ in ROTORS_FLU_M:
        if x > 0:
            height = ROTOR_Z_M - 0.055
            a = (x * 0.60, y * 0.60, 0.025 + (height - 0.025) * 0.47)
            b = (x * 0.78, y * 0.78, 0.025 + (height - 0.025) * 0.71)
            rings.append(tube(a, b, 0.033, 0.030))
    return join_meshes(arrow, *rings)


def blade_pair() -> Mesh:
    """Two slim blades; the node rotates about z."""
    r = ROTOR_RADIUS_M * 0.97
    outline = [(0.02, 0.012), (r * 0.35, 0.028), (r, 0.010), (r, -0.006), (r * 0.35, -0.016), (0.02, -0.012)]
    blade = np.asarray([(x, y, 0.0) for x, y in outline], np.float32)
    opposite_blade = blade * np.asarray([-1, -1, 1], np.float32)
    fan = np.asarray([(0, i, i + 1) for i in range(1, len(outline) - 1)], np.uint32)
    hub = tube((0, 0, -0.012), (0, 0, 0.018), 0.022, 0.014)
    return join_meshes(Mesh(blade, fan), Mesh(opposite_blade, fan), hub)


def rotor_discs() -> Mesh:
    """The four swept discs."""
    return join_meshes(*(move_mesh(disc(ROTOR_RADIUS_M), rotor_m) for rotor_m in ROTORS_FLU_M))


def rotor_rims() -> Points:
    """The four discs' edges."""
    return np.concatenate([ring_segments(ROTOR_RADIUS_M, rotor_m) for rotor_m in ROTORS_FLU_M])


def camera_ball() -> Mesh:
    """The gimbal's camera, looking along x."""
    ball = rounded_box((0.06, 0.052, 0.056), roundness=0.75)
    return join_meshes(ball, tube((0.02, 0, 0), (0.078, 0, 0), 0.040, 0.036))


def camera_lens_ring() -> Points:
    """The bright edge of the lens, which shows where the camera points."""
    ring = ring_segments(0.037, sides=24)
    return np.stack([ring[..., 2] + 0.080, ring[..., 0], ring[..., 1]], axis=-1).astype(np.float32)


def frustum() -> tuple[Mesh, Points]:
    """The camera's field of view, one metre deep: its four sides, the far face, and its edges."""
    w, h = FRUSTUM_HALF_WIDTH, FRUSTUM_HALF_HEIGHT
    corners = [(1.0, w, h), (1.0, -w, h), (1.0, -w, -h), (1.0, w, -h)]
    apex = (0.0, 0.0, 0.0)
    vertices = np.asarray([apex, *corners], np.float32)
    faces = [(0, 1 + i, 1 + (i + 1) % 4) for i in range(4)] + [(1, 2, 3), (1, 3, 4)]
    edges = [(apex, c) for c in corners] + [(corners[i], corners[(i + 1) % 4]) for i in range(4)]
    return Mesh(vertices, np.asarray(faces, np.uint32)), np.asarray(edges, np.float32)


def vehicle_outline() -> Points:
    """Outline of a vehicle, drawn at a target or for a simulated vehicle."""
    hub = [((0.0, 0.0, 0.02), rotor_m) for rotor_m in ROTORS_FLU_M]
    nose = [
        ((0.30, 0.0, 0.02), (0.14, 0.10, 0.02)),
        ((0.30, 0.0, 0.02), (0.14, -0.10, 0.02)),
    ]
    return np.concatenate([rotor_rims(), np.asarray(hub + nose, np.float32)])


def dots(count: int = 24, filled: float = 0.35) -> Points:
    """A dotted line from x 0 to x 1; `filled` is the drawn fraction of the line."""
    start = np.arange(count) / count
    out = np.zeros((count, 2, 3), np.float32)
    out[:, 0, 0], out[:, 1, 0] = start, start + filled / count
    return out


def rotor_quaternions(angles_rad: tuple[float, ...]) -> NDArray[np.float32]:
    """(4, 4): each rotor turned about its own axis."""
    # NumPy's own functions cost several times as much for four angles.
    return np.array([(math.cos(a / 2), 0.0, 0.0, math.sin(a / 2)) for a in angles_rad], np.float32)


def q_along(direction: Vector3) -> Quaternion:
    """The shortest rotation of the x axis to this direction; the identity if it has no length."""
    x, y, z = direction
    length = math.sqrt(x * x + y * y + z * z)
    if length < 1e-9:
        return (1.0, 0.0, 0.0, 0.0)
    w = 1.0 + x / length
    if w < 1e-6:
        return (0.0, 0.0, 0.0, 1.0)
    norm = math.sqrt(w * w + (y * y + z * z) / (length * length))
    return (w / norm, 0.0, -z / length / norm, y / length / norm)


def _grid_faces(rings: int, sides: int) -> Faces:
    faces: list[tuple[int, int, int]] = []
    for r in range(rings):
        for s in range(sides):
            a, b = r * sides + s, r * sides + (s + 1) % sides
            faces += [(a, b, a + sides), (b, b + sides, a + sides)]
    return np.asarray(faces, np.uint32)
