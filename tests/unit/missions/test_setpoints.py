"""The list of setpoint kinds is complete, and each kind is an immutable value."""

import dataclasses
from typing import get_args

import pytest

from missions import setpoints
from missions.setpoints import KINDS, Path, PathPoint, Setpoint, complete_vector, zeros_for_none


def test_each_setpoint_kind_is_listed_under_its_type_name():
    declared_kinds = {
        value
        for value in vars(setpoints).values()
        if dataclasses.is_dataclass(value) and isinstance(getattr(value, "type", None), str)
    }
    assert set(get_args(Setpoint)) == declared_kinds
    assert {name: kind.type for name, kind in KINDS.items()} == {name: name for name in KINDS}
    assert len(KINDS) == len(declared_kinds)


@pytest.mark.parametrize("kind", KINDS.values(), ids=lambda kind: kind.type)
def test_a_setpoint_cannot_be_changed(kind):
    field = dataclasses.fields(kind)[0].name
    setpoint = kind(*[0.0 for f in dataclasses.fields(kind) if f.default is dataclasses.MISSING])
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(setpoint, field, 1.0)


@pytest.mark.parametrize(
    ("setpoint", "estimates"),
    [
        (setpoints.Trajectory(position_ned_m=(1.0, 2.0, 3.0)), ("position", "velocity")),
        (setpoints.Trajectory(velocity_ned_m_s=(1.0, 0.0, 0.0)), ("velocity",)),
        (
            setpoints.PositionGlobal(47.0, 8.0, alt_home_m=5.0),
            ("position", "velocity", "global_position", "home"),
        ),
        (setpoints.Follow("2", (5.0, 0.0, 0.0)), ("position", "velocity", "global_position", "heading")),
        (setpoints.Follow("2", (5.0, 0.0, 0.0), yaw="same"), ("position", "velocity", "global_position")),
    ],
)
def test_a_setpoint_needs_the_estimates_for_its_fields(setpoint, estimates):
    assert setpoints.needs_of(setpoint) == estimates


def test_a_vector_is_complete_only_with_all_its_axes():
    assert complete_vector((1.0, 2.0, 3.0)) == (1.0, 2.0, 3.0)
    assert complete_vector((1.0, None, 3.0)) is None
    assert zeros_for_none((1.0, None, 3.0)) == (1.0, 0.0, 3.0)


def test_a_path_lasts_until_its_last_point():
    assert Path((PathPoint(0.0, (0.0, 0.0, 0.0)), PathPoint(7.5, (1.0, 0.0, 0.0)))).duration_s == 7.5
