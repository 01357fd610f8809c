"""Each journaled route passes its command's name to `authorized_command`; other routes do not call it."""

import ast
import inspect
import textwrap

from gcs_server.api.command_routes import COMMAND_OF
from gcs_server.api.permission import calls_of
from gcs_server.api.schema import bare_app
from gcs_server.api.setpoints import apply_setpoint
from gcs_server.control.commands import BY_CALL

AUTHORIZING = {
    "authorized_command",
    "run_command",
    "run_flight_command",
    "command_mission",
    "start_mission",
    "authorized_commands",
}
"""Functions that get the name of a command and pass it to `authorized_command`."""
FURTHER_COMMANDS = {"POST /api/v1/vehicles/{v}/mission/upload": {"hold"}}
"""Routes that may give another command first, which needs no more than their own: an upload with
`hold_first`."""


def commands_of(function):
    """Names that a function passes to `authorized_command`."""
    if function in COMMAND_OF:
        return {COMMAND_OF[function]}
    nodes = ast.walk(ast.parse(textwrap.dedent(inspect.getsource(function))))
    calls = [node for node in nodes if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)]
    if any(call.func.id == "apply_setpoint" for call in calls):
        return commands_of(apply_setpoint)
    constants = [
        arg
        for call in calls
        if call.func.id in AUTHORIZING
        for arg in call.args
        if isinstance(arg, ast.Constant)
    ]
    return {constant.value for constant in constants if isinstance(constant.value, str)}


def test_every_route_uses_authorized_command_as_the_command_table_says():
    routes = [(call, endpoint) for call, endpoint in calls_of(bare_app()) if not call.startswith("WS ")]
    assert len(routes) > 70
    wrong_commands = {
        call: commands_of(endpoint)
        for call, endpoint in routes
        if commands_of(endpoint) - FURTHER_COMMANDS.get(call, set())
        != ({BY_CALL[call].name} if BY_CALL[call].journaled else set())
    }
    assert wrong_commands == {}


def test_commands_that_change_a_flight_are_journaled():
    """A new command that needs control but is not journaled fails this test."""
    not_journaled = {row.name for row in BY_CALL.values() if not row.journaled}
    assert {row.name for row in BY_CALL.values() if row.control != "none"} & not_journaled == {
        "control/renew"
    }
    changing_commands = {
        row.name for call, row in BY_CALL.items() if not call.startswith(("GET ", "WS "))
    } & not_journaled
    assert changing_commands == {
        "agents/call",
        "control/renew",
        "files/list",
        "flights/add_part",
        "flights/rerun",
        "maps",
        "mission/download",
        "params/refresh",
        "param_changes/review",
        "plans",
        "readiness/check",
        "replays/change",
        "scene",
        "settings",
        "vehicles/futures",
    }
