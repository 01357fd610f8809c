"""PX4 publishes its control mode every 0.504 s, and at a change of the state."""

import pytest

from vehicle_sim.autopilot.offboard import ControlMode
from vehicle_sim.control.setpoints import ControlLevel

TICK_S = 0.02


def published_s(end_s: float, state_changes_s: tuple[float, ...] = ()) -> list[float]:
    """The times at which a level that alternates at each publication is published."""
    mode, found, level = ControlMode(), [], ControlLevel.ATTITUDE
    for tick in range(round(end_s / TICK_S)):
        now_s = tick * TICK_S
        if mode.update(now_s, level, sum(now_s >= at_s for at_s in state_changes_s)) is level:
            found.append(now_s)
            is_attitude = level is ControlLevel.ATTITUDE
            level = ControlLevel.TRAJECTORY if is_attitude else ControlLevel.ATTITUDE
    return found


def test_the_period_is_half_a_second_and_four_milliseconds():
    times_s = published_s(41.0)
    assert len(times_s) == 82  # 83 with half a second
    assert times_s[-1] == pytest.approx(81 * 0.504, abs=TICK_S)


def test_a_change_of_the_state_is_published_at_once_and_begins_a_new_period():
    assert published_s(3.0, (1.2,)) == pytest.approx([0.0, 0.52, 1.02, 1.2, 1.72, 2.22, 2.72], abs=1e-6)


def test_a_new_level_is_published_at_the_end_of_the_period():
    mode = ControlMode()
    mode.update(0.0, ControlLevel.TRAJECTORY, "armed")
    assert mode.update(0.5, ControlLevel.ATTITUDE, "armed") is ControlLevel.TRAJECTORY
    assert mode.update(0.504, ControlLevel.ATTITUDE, "armed") is ControlLevel.ATTITUDE
