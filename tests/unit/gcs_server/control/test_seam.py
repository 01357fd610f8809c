"""Every route that can change something passes the seam, or is named here with the reason why not."""

import ast
from pathlib import Path

API = Path(__file__).resolve().parents[4] / "gcs_server" / "api"
CHANGING = {"post", "put", "patch", "delete"}
SEAMS = {"journaled", "carry_out", "apply", "together"}
"""`carry_out`, `apply` and `together` call `journaled`; see the test below."""
COMMANDS_NOTHING = {
    "refresh_params": "reads them anew",
    "check": "asks the vehicle for its own checks",
    "change_replay": "a recording",
}


def functions():
    for path in sorted(API.glob("*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                yield path.name, node


def called(function):
    calls = [node.func for node in ast.walk(function) if isinstance(node, ast.Call)]
    return {call.id for call in calls if isinstance(call, ast.Name)}


def methods(function):
    decorators = [d.func for d in function.decorator_list if isinstance(d, ast.Call)]
    return {d.attr for d in decorators if isinstance(d, ast.Attribute)} & CHANGING


def test_every_route_that_changes_something_passes_the_seam():
    routes = {(file, f.name): called(f) for file, f in functions() if methods(f)}
    assert len(routes) > 30
    past = {
        name for (file, name), calls in routes.items() if file != "control_routes.py" and not calls & SEAMS
    }
    assert past == set(COMMANDS_NOTHING)


def test_the_seams_helpers_are_the_seam():
    helpers = {f.name: called(f) for _, f in functions() if f.name in SEAMS - {"journaled"}}
    assert set(helpers) == SEAMS - {"journaled"}
    assert all("journaled" in calls for calls in helpers.values())
