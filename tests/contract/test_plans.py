"""A simulated vehicle keeps, refuses and says of plans what a real PX4 does (`px4/items`).

A test fails for a difference without a row in `explained_plans.tsv`, and for a row without a difference.
"""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

from tests.contract.plan_dialogues import (
    begins_on_ground,
    dialogue_differences,
    explained,
    item_differences,
    new_vehicle,
)
from tests.contract.replay_vehicle import Vehicle

MAX_ROWS = 10
ITEM_COUNT, DIALOGUE_COUNTS = 835, {"fence": 103, "rally": 32, "mission_state": 118}
EACH_ITEM = 40
SAMPLE = (
    "fence_incl_polygon_frame0", "fence_incl_polygon4_param1_-4", "fence_excl_mixed_param1",
    "fence_home_in_exclusion_circle", "fence_broken_after_2_cancel15", "fence_items_of_type_0",
    "rally_params", "rally_frame5", "rally_refused_item_keeps_old", "reupload_ground_identical_again",
    "reupload_ground_changed_altitude", "set_current_message_7_disarmed", "feasible_starts_with_land",
    "feasible_MIS_TKO_LAND_REQ4_no_land", "start_MISSION_START_0ms_after_ack_previous_other",
)  # fmt: skip
"""Dialogues of `make test`; `make nightly` replays all."""


def cases(reference_data: Path, name: str) -> list[dict[str, Any]]:
    """The lines of a file of recordings."""
    path = reference_data / "px4" / "items" / f"{name}.jsonl"
    if not path.is_file():
        pytest.skip(f"{path.name} of the recorded plans is not beside this checkout")
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def replay_items(recorded: Iterable[dict[str, Any]]) -> dict[str, list[str]]:
    vehicle, previous = new_vehicle(), ""
    found: dict[str, list[str]] = {}
    for case in recorded:
        if case["requests"][0] == "F0" and previous != "MISSION_ITEM":
            vehicle = new_vehicle()  # PX4 requests MISSION_ITEM until it has received a MISSION_ITEM_INT
        elif not previous:
            item_differences(vehicle, case)
        found[case["id"]] = item_differences(vehicle, case)
        previous = case["msg"]
    return {name: rows for name, rows in found.items() if rows}


def replay_dialogues(recorded: Iterable[dict[str, Any]]) -> dict[str, list[str]]:
    vehicle: Vehicle | None = None
    found: dict[str, list[str]] = {}
    for dialogue in recorded:
        if vehicle is None or (not vehicle.commander.landed and begins_on_ground(dialogue)):
            vehicle = new_vehicle()
        found[dialogue["id"]] = dialogue_differences(vehicle, dialogue)
    return {name: rows for name, rows in found.items() if rows}


def test_a_sample_of_items_is_stored_and_refused_as_by_px4(reference_data: Path) -> None:
    recorded = [case for case in cases(reference_data, "items") if case["requests"][0] == "I0"]
    assert replay_items(recorded[::EACH_ITEM]) == {}


def test_a_sample_of_dialogues_about_plans_is_as_recorded(reference_data: Path) -> None:
    recorded = [d for name in DIALOGUE_COUNTS for d in cases(reference_data, name) if d["id"] in SAMPLE]
    assert len(recorded) == len(SAMPLE)
    assert replay_dialogues(recorded) == {}


@pytest.mark.broad
@pytest.mark.timeout(600)
def test_all_items_are_stored_and_refused_as_by_px4(reference_data: Path) -> None:
    recorded = cases(reference_data, "items")
    assert len(recorded) == ITEM_COUNT
    assert replay_items(recorded) == {}


@pytest.mark.broad
@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", DIALOGUE_COUNTS)
def test_all_dialogues_about_plans_have_only_explained_differences(reference_data: Path, name: str) -> None:
    recorded = cases(reference_data, name)
    assert len(recorded) == DIALOGUE_COUNTS[name]
    differences, rows = replay_dialogues(recorded), explained()
    assert {dialogue: found for dialogue, found in differences.items() if dialogue not in rows} == {}
    stale = {d["id"] for d in recorded} & rows.keys() - differences.keys()
    assert not stale, f"no longer a difference, delete these rows: {stale}"


def test_the_table_of_differences_is_short() -> None:
    assert len(explained()) <= MAX_ROWS
    assert all(explained().values())


def test_the_comparison_finds_a_changed_answer(reference_data: Path) -> None:
    case = next(case for case in cases(reference_data, "items") if case["id"] == "cmd21_autocontinue2")
    downloaded = {**case["downloaded"], "autocontinue": 1}
    changed = {**case, "downloaded": downloaded, "ack": {"type": 1, "opaque_id": 0}}
    vehicle = new_vehicle()
    item_differences(vehicle, case)
    assert item_differences(vehicle, case) == []
    found = [row.split(":")[0] for row in item_differences(vehicle, changed)]
    assert found == ["acks", "item 2 autocontinue"]
    unexpected = {**case, "events": [{"dt_s": 0.0, "name": "navigator_mis_vtol_items", "args": {}}]}
    assert [row.split(":")[0] for row in item_differences(vehicle, unexpected)] == ["told"]
