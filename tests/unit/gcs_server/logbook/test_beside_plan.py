"""A flight beside its plan and dry run: figures as computed by hand, and what of them is a finding."""

import math

from gcs_server.logbook.beside_plan import beside_plan, plan_findings


def plan_of(deviations, outside, *, duration_s=100.0, planned_s=100.0, battery=(1.0, 0.6), predicted=0.4):
    samples = [
        {"t_s": 0.5 * n, "place": f"item {n // 20}", "deviation_m": deviation, "outside_corridor_m": out}
        for n, (deviation, out) in enumerate(zip(deviations, outside, strict=True))
    ]
    flown = {
        "samples": samples,
        "duration_s": duration_s,
        "planned_duration_s": planned_s,
        "battery_start_share": battery[0],
        "battery_end_share": battery[1],
    }
    return {"flown": flown, "predicted_battery_used_share": predicted}


def test_the_largest_and_the_rms_distance_have_their_place_and_time_on_the_main_log():
    compared = beside_plan(plan_of([None, 3.0, 4.0, None], [None] * 4), 20.0)
    assert (compared.deviation_max_m, compared.deviation_max_s) == (4.0, 21.0)
    assert compared.deviation_max_place == "item 0"
    assert compared.deviation_rms_m == round(math.sqrt(12.5), 2)
    assert (compared.battery_used_share, compared.predicted_battery_used_share) == (0.4, 0.4)
    assert (compared.has_corridor, compared.far_from_path, compared.outside_corridor) == (False, (), ())
    assert plan_findings(compared, "1", 20.0) == []


def test_each_time_outside_the_corridor_or_far_from_the_path_is_a_finding_with_its_place():
    deviations = [1.0] * 100
    outside = [0.0] * 100
    for n in (10, 11, 13, 60):  # 5.0 to 6.5 s, and 30.0 s
        deviations[n], outside[n] = 6.0 + n / 100, n / 10
    compared = beside_plan(plan_of(deviations, outside), 20.0)
    assert [(e.begin_s, e.end_s, e.max_m, e.place) for e in compared.outside_corridor] == [
        (25.0, 26.5, 1.3, "item 0"),
        (50.0, 50.0, 6.0, "item 3"),
    ]
    found = plan_findings(compared, "7", 20.0)
    assert [(f["kind"], f["severity"], f["begin_s"], f["vehicle"]) for f in found] == [
        ("corridor", "warning", 25.0, "7"),
        ("corridor", "warning", 50.0, "7"),
        ("deviation", "caution", 25.0, "7"),
        ("deviation", "caution", 50.0, "7"),
    ]
    assert found[1]["text"] == "The vehicle was up to 6.0 m outside the corridor of its dry run, at item 3."
    assert found[3]["text"] == "The vehicle was up to 6.6 m from the planned path, at item 3."


def test_more_time_and_more_battery_than_predicted_are_findings_and_a_little_more_is_none():
    compared = beside_plan(plan_of([0.0], [None], duration_s=121.0, battery=(0.9, 0.39)), 0.0)
    assert [f["kind"] for f in plan_findings(compared, "1", 0.0)] == ["duration", "energy"]
    compared = beside_plan(plan_of([0.0], [None], duration_s=114.0, battery=(0.9, 0.41)), 0.0)
    assert plan_findings(compared, "1", 0.0) == []


def test_what_is_not_known_is_none_and_no_finding():
    plan = plan_of([None], [None], planned_s=None, battery=(None, None), predicted=None)
    compared = beside_plan(plan, 0.0)
    assert (compared.deviation_max_m, compared.deviation_rms_m, compared.deviation_max_s) == (None,) * 3
    assert (compared.battery_used_share, compared.planned_duration_s) == (None, None)
    assert plan_findings(compared, "1", 0.0) == []
    assert beside_plan({"flown": None}, 0.0) is None
    old = plan_of([1.0], [None])
    del old["predicted_battery_used_share"]  # noted by an earlier version
    assert beside_plan(old, 0.0).predicted_battery_used_share is None
