"""Two flights over each other: the offset by arming, take-off and best fit, and how far apart they were."""

import dataclasses

import numpy as np
import pytest

from gcs_server.logbook.log import Log, Span, Topic, VehicleStates
from gcs_server.logbook.two_flights import METRES_PER_DEG, CannotCompare, Part, compare

ARMED_S, TAKEN_OFF_S, LANDED_S, END_S = 5.0, 9.0, 69.0, 75.0


def flight(late_s=0.0, east_m=0.0, up_m=0.0, current_a=10.0, north=lambda t: 40 * np.sin(0.1 * t)):
    """A flight of 60 s whose vehicle was armed at 5 s and took off at 9 s, all `late_s` later."""

    def topic(name, hz, **fields):
        t_s = np.arange(0.0, END_S + late_s, 1 / hz)
        own = np.clip(t_s - late_s - TAKEN_OFF_S, 0.0, LANDED_S - TAKEN_OFF_S)
        columns = {k: np.asarray(v(own) if callable(v) else np.full(len(t_s), v)) for k, v in fields.items()}
        return Topic(name, "0", t_s, columns, {})

    position = topic(
        "vehicle_global_position",
        5,
        lat=lambda t: 47.0 + north(t) / METRES_PER_DEG,
        lon=lambda t: 8.0 + (0.5 * t + east_m) / (METRES_PER_DEG * np.cos(np.radians(47.0))),
        alt=lambda t: 488.0 + up_m + 10.0 * np.minimum(1.0, t / 5.0),
    )
    air = topic("vehicle_land_detected", 5, landed=lambda t: (t <= 0.0) | (t >= LANDED_S - TAKEN_OFF_S))
    battery = topic(
        "battery_status", 2, voltage_v=16.0, current_a=current_a, remaining=lambda t: 1 - 0.005 * t
    )
    states = VehicleStates("1", armed=[Span(ARMED_S + late_s, END_S + late_s, "armed")])
    return Log("ulog", None, END_S + late_s, [position, air, battery], [states])


def part(late_s=0.0):
    return Part("1", ARMED_S + late_s, END_S + late_s)


@pytest.mark.parametrize("align", ["arming", "takeoff", "fit"])
def test_the_same_flight_at_another_time_is_nowhere_apart(align):
    found = compare([flight(), flight(late_s=31.3)], [part(), part(31.3)], align)
    assert found.offset_s == pytest.approx(-31.3, abs=0.21)
    assert found.max_m < 1.0
    assert found.notes == []


def test_take_off_may_come_later_after_arming_than_in_the_other_flight():
    second = flight(late_s=20.0)
    armed_late = dataclasses.replace(
        second, vehicles=[VehicleStates("1", armed=[Span(28.0, END_S + 20, "armed")])]
    )
    parts = [part(), Part("1", 28.0, END_S + 20)]
    assert compare([flight(), armed_late], parts, "takeoff").offset_s == pytest.approx(-20.0, abs=0.21)
    assert compare([flight(), armed_late], parts, "arming").offset_s == pytest.approx(-23.0)


def test_the_distance_is_that_of_the_tracks_at_the_same_times():
    found = compare([flight(), flight(east_m=3.0, up_m=4.0)], [part(), part()], "arming")
    assert found.distance_m == pytest.approx([5.0] * len(found.t_s), abs=0.02)
    assert found.over_ground_m == pytest.approx([3.0] * len(found.t_s), abs=0.02)
    assert found.above_m == pytest.approx([4.0] * len(found.t_s), abs=0.01)
    assert (found.max_m, found.rms_m) == (pytest.approx(5.0, abs=0.02), pytest.approx(5.0, abs=0.02))
    assert found.shared_s == pytest.approx(70.0, abs=0.5)


def test_duration_distance_height_and_energy_of_both():
    found = compare([flight(), flight(current_a=12.0)], [part(), part()], "arming")
    assert found.first.duration_s == 70.0
    assert found.first.energy_wh == pytest.approx(16 * 10 * 69.5 / 3600, rel=0.01)
    assert found.second.energy_wh == pytest.approx(1.2 * found.first.energy_wh, rel=0.001)
    assert found.second.charge_mah == pytest.approx(12 * 69.5 / 3.6, rel=0.01)
    assert found.first.battery_used_share == pytest.approx(0.3)
    assert found.first.height_m == pytest.approx(10.0)
    t = np.linspace(0, 60, 2000)
    true_m = np.sum(np.hypot(np.diff(40 * np.sin(0.1 * t)), np.diff(0.5 * t)))
    assert found.first.distance_m == pytest.approx(true_m, rel=0.02)


def test_an_unmeasured_current_is_no_energy():
    found = compare([flight(), flight(current_a=-1.0)], [part(), part()], "arming")
    assert (found.second.energy_wh, found.second.charge_mah) == (None, None)


def test_a_flight_of_laps_says_that_another_offset_fits_as_well():
    laps = flight()
    angle_rad = 2 * np.pi * laps.topics[0].times_s / 20
    laps.topics[0].columns["lat"][:] = 47.0 + 2e-4 * np.sin(angle_rad)
    laps.topics[0].columns["lon"][:] = 8.0 + 3e-4 * np.cos(angle_rad)
    laps.topics[0].columns["alt"][:] = 490.0
    found = compare([laps, laps], [part(), part()], "fit")
    assert found.rms_m < 0.5
    assert "fits nearly as well" in found.notes[0]


def test_a_gap_has_no_distance():
    second = flight()
    cut = (second.topics[0].times_s > 20) & (second.topics[0].times_s < 30)
    gap = Topic(
        "vehicle_global_position",
        "0",
        second.topics[0].times_s[~cut],
        {name: values[~cut] for name, values in second.topics[0].columns.items()},
        {},
    )
    second.topics[0] = gap
    found = compare([flight(), second], [part(), part()], "arming")
    unknown = [t_s for t_s, each in zip(found.t_s, found.distance_m, strict=True) if each is None]
    assert unknown[0] == pytest.approx(20.2, abs=0.3)
    assert unknown[-1] == pytest.approx(29.8, abs=0.3)


def test_an_offset_is_taken_as_it_is():
    found = compare([flight(), flight()], [part(), part()], "offset", 10.0)
    assert found.offset_s == 10.0
    assert found.t_s[0] == pytest.approx(15.0)


@pytest.mark.parametrize(
    ("logs", "align", "field", "words"),
    [
        (lambda: [flight(), Log("ulog", None, 5.0, [], [])], "arming", "other", "no positions"),
        (lambda: [Log("ulog", None, 5.0, [], []), flight()], "arming", "f", "no positions"),
        (lambda: [flight(), flight()], "offset", "offset_s", "do not overlap"),
    ],
)
def test_what_cannot_be_compared_is_refused_with_the_reason(logs, align, field, words):
    with pytest.raises(CannotCompare, match=words) as refused:
        compare(logs(), [Part(""), Part("")], align, 500.0)
    assert refused.value.field == field


def test_without_take_off_or_arming_that_cannot_be_the_common_moment():
    unarmed, on_ground = flight(), flight()
    unarmed.vehicles[0].armed.clear()
    with pytest.raises(CannotCompare, match="In the second log the vehicle was not armed"):
        compare([flight(), unarmed], [part(), Part("1")], "arming")
    on_ground.topics[1].columns["landed"][:] = 1
    with pytest.raises(CannotCompare, match="In the second flight the vehicle did not take off"):
        compare([flight(), on_ground], [part(), part()], "takeoff")
    del on_ground.topics[1]
    with pytest.raises(CannotCompare, match="does not say when the vehicle took off"):
        compare([flight(), on_ground], [part(), part()], "takeoff")
