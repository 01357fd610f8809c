"""The tools of agents follow the table of commands and the API's description."""

import json

import pytest

from gcs_server.agents.own_tools import OWN_TOOLS
from gcs_server.agents.tools import FOR_PERSONS, LONG_SCHEMAS, PLAN_EXAMPLE, all_tools, includes, schema_of
from gcs_server.api.schema import description
from gcs_server.control.commands import ALL
from gcs_server.errors import InvalidRequest
from gcs_server.settings import AGENT_SCOPES
from missions.plan import Plan

NEVER = {
    "kill", "shell", "mavlink/send", "param", "param_changes/apply", "files/put", "files/remove", "restart",
    "logs/erase", "links/add", "links/remove", "vehicles/remove", "manual_control", "control/grant",
    "guards/resume", "agents/resume", "plans/delete", "home",
    "offboard/limits", "offboard/failsafe", "group/start",
}  # fmt: skip


@pytest.fixture(scope="module")
def tools():
    return all_tools(description())


def test_agents_never_get_what_harms_a_vehicle_or_allows_themselves_more():
    names = {command.name for command in ALL}
    assert names >= NEVER
    assert {command.name for command in ALL if command.agent is not None} & NEVER == set()


def test_a_command_that_acts_on_a_vehicle_needs_the_scope_of_simulated_vehicles():
    for command in ALL:
        if command.agent is not None and (command.acts != "no" or command.control != "none"):
            assert includes(command.agent, "simulated"), command.name
        if command.agent is not None and command.journaled:
            assert includes(command.agent, "plan"), command.name


def test_a_tool_that_commands_names_its_vehicle_in_the_path(tools):
    """The proof that it is simulated is asked of this vehicle."""
    for tool in tools.values():
        if includes(tool.scope, "simulated"):
            assert tool.in_path == {"v": "vehicle"}, tool.name


def test_the_tools_are_those_of_the_table(tools):
    assert len(tools) == sum(len(command.full_agent_calls()) for command in ALL)
    assert tools.keys() >= {
        "read_vehicles",
        "read_vehicle_mission",
        "plans_check",
        "takeoff",
        "mission_upload",
    }
    assert not tools.keys() & OWN_TOOLS.keys()
    assert all(set(command.agent_calls) <= set(command.calls) for command in ALL)


def test_no_tool_has_an_argument_by_which_a_person_accepts_a_danger(tools):
    for tool in tools.values():
        assert not {f'"{name}": {{' for name in FOR_PERSONS if f'"{name}": {{' in json.dumps(tool.schema)}, (
            tool.name
        )


def test_tools_are_short_for_a_model_and_complete(tools):
    shown = json.dumps([[tool.name, tool.description, tool.schema] for tool in tools.values()])
    assert len(shown) < 45_000
    assert "$ref" not in shown
    assert all(tool.description for tool in tools.values())


def test_a_call_is_made_of_path_query_and_body(tools):
    assert tools["takeoff"].request({"vehicle": "a/b", "alt_home_m": 5}) == (
        "/api/v1/vehicles/a%2Fb/takeoff",
        {},
        {"alt_home_m": 5},
    )
    path, query, body = tools["read_vehicle_messages"].request({"vehicle": "1", "since": 3})
    assert (path, query, body) == ("/api/v1/vehicles/1/messages", {"since": 3}, None)
    path, _, body = tools["plans_save"].request({"plan_id": "p", "name": "n", "plan": {}, "base_version": 1})
    assert (path, body) == ("/api/v1/plans/p", {"name": "n", "plan": {}, "base_version": 1})


def test_the_text_that_a_person_confirms_is_added_for_an_agent(tools):
    assert tools["land_now"].request({"vehicle": "1"})[2] == {"confirm": "vehicle 1 lands now"}


def test_a_wrong_argument_is_refused_and_the_accepted_ones_are_named(tools):
    with pytest.raises(InvalidRequest, match="has no argument 'despite'") as error:
        tools["mission_start"].request({"vehicle": "1", "despite": ["separation"]})
    assert error.value.remedy == "Accepted: dry_run, item, mission_id, vehicle."
    with pytest.raises(InvalidRequest, match="needs 'vehicle'"):
        tools["arm"].request({"vehicle": 1})


def test_the_example_of_a_plan_is_a_plan():
    assert [item.kind for item in Plan.model_validate_json(json.dumps(PLAN_EXAMPLE)).items] == [
        "takeoff",
        "waypoint",
        "land",
    ]


def test_long_schemas_exist():
    for call, argument, _ in LONG_SCHEMAS.values():
        assert schema_of(description(), call, argument)


def test_each_scope_includes_those_before_it():
    assert [[includes(a, b) for b in AGENT_SCOPES] for a in AGENT_SCOPES] == [
        [True, False, False, False],
        [True, True, False, False],
        [True, True, True, False],
        [True, True, True, True],
    ]
