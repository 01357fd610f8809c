"""Only physics, sensors and the simulated world read the true state; all other code uses measurements."""

import ast
from pathlib import Path

import pytest

import vehicle_sim
from vehicle_sim.autopilot.monitors import _air_speed

ROOT = Path(vehicle_sim.__file__).parent
WORLD_DIRECTORIES = ("physics", "sensors", "world")
TRUE_STATE_NAMES = frozenset({"truth", "TruthState", "motor_health", "_bodies", "steady_ned_m_s"})
"""Names of the true state and of functions that change it."""
PLANT_PARAMETER_PREFIX = "SIH_"
ALLOWED_FILES = {
    "airframe.py": "the plant's parameters",
    "state.py": "declares it",
    "simulation.py": "passes the true state from physics to sensors",
    "script.py": "faults may depend on the true height",
    "payload/camera.py": "a sensor: it renders the view from the true position",
    "mavlink/messages/motion.py": "HIL_STATE_QUATERNION, the ground truth that PX4's simulator sends",
    "mavlink/messages/sensors.py": "the data sheet of the range finder: SIH_DISTSNSR_*",
    "topics/arrays.py": "the ground truth topics of PX4's simulator",
}


def files_with_true_state() -> set[str]:
    """Files outside the simulated world that name the true state or a parameter of the plant."""
    files = set()
    for path in ROOT.rglob("*.py"):
        relative_path = path.relative_to(ROOT)
        if relative_path.parts[0] in WORLD_DIRECTORIES or path.name == "generated_dialect.py":
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = {getattr(node, attribute, "") for attribute in ("attr", "id", "name")}
            text = node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""
            if names & TRUE_STATE_NAMES or text.startswith(PLANT_PARAMETER_PREFIX):
                files.add(relative_path.as_posix())
    return files


def test_only_listed_files_read_the_true_state_or_the_plants_parameters():
    assert files_with_true_state() == set(ALLOWED_FILES)


@pytest.mark.parametrize("speed", [-12.0, -0.5, 0.0, 3.0, 20.0])
@pytest.mark.parametrize(
    ("momentum_coefficient", "ballistic_coefficient"), [(0.15, 100.0), (1.0, 0.0), (0.0, 25.0)]
)
def test_the_air_speed_is_the_inverse_of_the_drag_model(speed, momentum_coefficient, ballistic_coefficient):
    quadratic = 0.5 * 1.225 / ballistic_coefficient if ballistic_coefficient > 1.0 else 0.0
    drag = quadratic * abs(speed) * speed + momentum_coefficient * speed
    assert _air_speed(drag, momentum_coefficient, ballistic_coefficient) == pytest.approx(speed)


def test_a_drag_model_without_coefficients_gives_no_air_speed():
    assert _air_speed(3.0, 0.0, 0.0) == 0.0
