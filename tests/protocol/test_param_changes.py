"""Several parameters: reviewed, written as reviewed or not at all, undone; files, comparisons, restart."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from gcs_server.api import gimbal_setup_routes, param_change_routes, param_routes
from gcs_server.errors import ChangesRefused, InvalidRequest, NotInControl, Refused, Rejected
from gcs_server.vehicle.param_review import WantedParam
from gcs_server.vehicle.services.param_changes import ParamChange
from tests.protocol.api_calls import ANNA, BOB, json_of, new_station
from tests.protocol.described_vehicle import apply_values, run_with_vehicle

PARAM_SET = 23


def test_changes_are_written_as_reviewed_or_not_at_all_and_undone(run_simulated: Any) -> None:
    async def scenario(rig: Any) -> None:
        parameters = rig.autopilot.sim.autopilots[0].view.parameters
        sets = rig.autopilot.count(PARAM_SET)
        wanted = [
            WantedParam("MNT_RANGE_YAW", 5000.0),
            WantedParam("NO_SUCH", 1.0),
            WantedParam("MNT_MODE_IN", 1.5),
            WantedParam("MNT_DO_STAB", 1.0, is_integer=False),
            WantedParam("MNT_RATE_YAW", 40.0),
            WantedParam("MNT_RATE_YAW", 50.0),
            WantedParam("MNT_RATE_PITCH", 30.0),
            WantedParam("MNT_OFF_YAW", 4.0),
        ]
        rows = await rig.changes.review(wanted)
        assert [row.state for row in rows] == [*["refused"] * 6, "same", "change"]
        assert all(row.problem for row in rows[:6])
        assert (rows[7].old, rows[7].new, rows[7].unit) == (0.0, 4.0, "deg")
        with pytest.raises(ChangesRefused, match="Nothing was written") as refusal:
            await rig.changes.apply([ParamChange("MNT_OFF_YAW", 0.0, 4.0), ParamChange("NO_SUCH", 0.0, 1.0)])
        assert "NO_SUCH" in str(refusal.value.details())
        parameters.set("MNT_OFF_YAW", 7.0)  # meanwhile, another station
        with pytest.raises(ChangesRefused) as refusal:
            await rig.changes.apply([ParamChange("MNT_OFF_YAW", 0.0, 4.0)])
        assert "now has 7" in str(refusal.value.details())
        assert rig.autopilot.count(PARAM_SET) == sets, "nothing was sent"
        await apply_values(rig, {"MNT_OFF_YAW": 4.0, "MNT_RATE_YAW": 44.0})
        await apply_values(rig, {"MNT_OFF_YAW": 5.0})
        for expected in ((4.0, 44.0), (7.0, 30.0)):
            undo = await rig.changes.review(rig.changes.undone())
            await rig.changes.apply([ParamChange(r.name, r.old, r.new) for r in undo], undoes=True)
            assert (parameters.get("MNT_OFF_YAW"), parameters.get("MNT_RATE_YAW")) == expected
        with pytest.raises(Refused, match="no change"):
            rig.changes.undone()

    run_with_vehicle(run_simulated, scenario)


def test_a_value_that_was_not_taken_is_named_and_the_rest_is_written(run_simulated: Any) -> None:
    async def scenario(rig: Any) -> None:
        parameters = rig.autopilot.sim.autopilots[0].view.parameters
        store = parameters.set

        def limit(name: str, value: float) -> Any:
            return store(name, min(value, 3.0) if name == "MNT_OFF_YAW" else value)

        parameters.set = limit
        written = await apply_values(rig, {"MNT_OFF_YAW": 9.0, "MNT_OFF_ROLL": 2.0})
        assert [(row.name, row.state, row.now) for row in written.rows] == [
            ("MNT_OFF_YAW", "not_taken", 3.0),
            ("MNT_OFF_ROLL", "set", 2.0),
        ]
        assert "still has MNT_OFF_YAW = 3" in str(written.rows[0].problem)
        assert [each.name for each in rig.changes.undone()] == ["MNT_OFF_ROLL"]

    run_with_vehicle(run_simulated, scenario)


def test_only_the_client_in_control_writes_and_losing_it_ends_the_writing(run_simulated: Any) -> None:
    async def scenario(rig: Any) -> None:
        station = new_station(rig.testbed)

        def body(**values: float) -> param_change_routes.ApplyRequest:
            rows = [{"name": name, "old": 0.0, "value": value} for name, value in values.items()]
            return param_change_routes.ApplyRequest.model_validate({"changes": rows})

        answer = json_of(await param_change_routes.apply("1", body(MNT_OFF_YAW=2.0), station, ANNA))
        assert (answer["last"]["rows"][0]["state"], answer["undo_count"]) == ("set", 1)
        with pytest.raises(NotInControl):
            await param_change_routes.apply("1", body(MNT_OFF_ROLL=2.0), station, BOB)
        checks = iter([None, NotInControl("1", holder="bob", holder_key="bob", can_be_asked=True)])

        def may_go_on() -> None:
            problem = next(checks)
            if problem is not None:
                raise problem

        changes = [ParamChange("MNT_OFF_ROLL", 0.0, 2.0), ParamChange("MNT_OFF_PITCH", 0.0, 2.0)]
        written = await rig.changes.apply(changes, may_go_on=may_go_on)
        assert [row.state for row in written.rows] == ["set", "not_written"]
        assert "bob has control" in str(written.stopped)

    run_with_vehicle(run_simulated, scenario)


def test_a_restart_is_confirmed_disarmed_only_and_refused_by_a_simulated_px4(run_simulated: Any) -> None:
    async def scenario(rig: Any) -> None:
        station = new_station(rig.testbed)
        request = param_change_routes.RestartRequest
        with pytest.raises(InvalidRequest, match="confirmation"):
            await param_change_routes.restart("1", request(confirm="yes"), station, ANNA)
        confirmed = request(confirm="vehicle 1 restarts")
        with pytest.raises(Rejected, match="refuses to restart") as refusal:
            await param_change_routes.restart("1", confirmed, station, ANNA)
        assert "start it again" in str(refusal.value.remedy)
        await asyncio.sleep(15)
        await rig.vehicle.command.arm()
        with pytest.raises(Refused, match="is armed"):
            await param_change_routes.restart("1", confirmed, station, ANNA)
        with pytest.raises(Refused, match="is armed"):
            await rig.changes.apply([ParamChange("MNT_OFF_YAW", 0.0, 4.0)])
        shown = json_of(await gimbal_setup_routes.show_setup(rig.vehicle))
        assert shown["setup"]["findings"][0]["code"] == "input_none"
        assert shown["params"][0] | {"facts": None} == {
            "name": "MNT_MODE_IN",
            "value": -1,
            "is_integer": True,
            "is_default": True,
            "facts": None,
        }

    run_with_vehicle(run_simulated, scenario)


def test_a_file_the_defaults_and_another_vehicle_are_compared_and_nothing_is_written(
    run_simulated: Any,
) -> None:
    async def scenario(rig: Any) -> None:
        station = new_station(rig.testbed)

        async def review(**body: Any) -> dict[str, Any]:
            request = param_change_routes.ReviewRequest.model_validate(body)
            return json_of(await param_change_routes.review(rig.vehicle, request, station))

        sets = rig.autopilot.count(PARAM_SET)
        file = bytes((await param_change_routes.show_file(rig.vehicle)).body).decode()
        assert "1\t1\tMNT_MODE_IN\t-1\t6" in file
        same = await review(file=file)
        assert {row["state"] for row in same["rows"]} == {"same"}
        assert (len(same["rows"]), same["notes"]) == (913, [])
        changed = file.replace("MNT_RATE_YAW\t30\t9", "MNT_RATE_YAW\t40\t9")
        changed += "9\t1\tNO_SUCH\t1\t6\nbroken\n1\t1\tMNT_LND_P_MAX\t1\t6\n1\t1\tMNT_DO_STAB\t7\t6\n"
        shown = await review(file=changed)
        lines = len(file.splitlines())
        refused = {row["line"] - lines: row["problem"] for row in shown["rows"] if row["state"] == "refused"}
        assert sorted(each for each in refused if each > 0) == [1, 2, 3, 4]
        assert "no parameter of this name" in refused[1]
        assert [row["name"] for row in shown["rows"] if row["state"] == "change"] == ["MNT_RATE_YAW"]
        assert "vehicle 1, 9; this is vehicle 1" in shown["notes"][0]
        defaults = await review(defaults=True)
        differing = {row["name"] for row in defaults["rows"] if row["state"] == "change"}
        assert "MNT_MODE_IN" not in differing
        assert "SYS_AUTOSTART" in differing, "the start script has set it"
        other = await review(of_vehicle="1")
        assert {row["state"] for row in other["rows"]} == {"same"}
        assert rig.autopilot.count(PARAM_SET) == sets
        with pytest.raises(ValueError, match="exactly one"):
            await review(defaults=True, undo=True)

    run_with_vehicle(run_simulated, scenario)


def test_a_parameter_that_was_set_singly_is_undone_too(run_simulated: Any) -> None:
    async def scenario(rig: Any) -> None:
        station = new_station(rig.testbed)
        request = param_routes.ParamRequest(value=2)
        await param_routes.set_param("1", "MNT_MODE_OUT", request, station, ANNA)
        assert rig.changes.waiting() == ("MNT_MODE_OUT",)
        assert [(each.name, each.value) for each in rig.changes.undone()] == [("MNT_MODE_OUT", 0)]

    run_with_vehicle(run_simulated, scenario)
