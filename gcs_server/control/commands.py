"""The table of commands: the required permission, control and confirmation, and whether the journal records
them. Routes, WebSocket messages, the journal, `docs/authority.md` and the OpenAPI description (`x-authority`)
use this table. The server does not start if a route has no row.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from gcs_server.errors import InvalidRequest
from gcs_server.settings import AgentScope

API = "/api/v1"

Permission = Literal["view", "control", "fly", "stop", "payload", "configure", "station", "replay", "plan"]
"""Permissions that a role may have. `view`: reading everything; `control`: taking and releasing control;
`fly`: modes, arming, setpoints; `stop`: Hold, Land now, Kill; `payload`: gimbals and cameras;
`configure`: parameters, limits, failsafe, checks; `station`: links and vehicles; `replay`: playing
recordings; `plan`: saving and deleting plans."""
PERMISSIONS: frozenset[Permission] = frozenset(get_args(Permission))

Control = Literal["none", "lease", "open", "not_anothers", "changes"]
"""`none`: the command is sent to no vehicle. `lease`: the caller needs control, and takes it if no client has
it. `open`: does not need control; the client in control keeps control and is informed. `not_anothers`:
refused while another client has control; does not take control. `changes`: the command changes control."""

Acts = Literal["no", "moves", "stops"]
"""How a command acts on a vehicle. `moves`: it may begin or change a flight; it is an operation, which a
later command, the end of its client's control, the end of its client's connection or the operation's
cancellation ends. `stops`: it ends a flight or a command that moves; the end of its client's connection does
not end it. `no`: it neither moves nor stops."""

CONTROL_TEXT: dict[Control, str] = {
    "none": "–",
    "lease": "required",
    "open": "open",
    "not_anothers": "free",
    "changes": "changes",
}
"""The words of the table in `docs/authority.md`, which explains them."""


@dataclass(frozen=True, slots=True)
class Command:
    """One row of the table: the requirements of one command."""

    name: str
    """Name in the journal."""
    permission: Permission | None
    """The required permission; None: the token is sufficient."""
    calls: tuple[str, ...]
    """`METHOD /path`, below `/api/v1` unless it begins with `//`; for a WebSocket message `WS /path
    message`."""
    control: Control = "none"
    vehicles: str = ""
    """The vehicles for which control is needed."""
    confirmed: bool = False
    """Whether the page asks the operator for confirmation."""
    confirm_text: str | None = None
    """Required text of the request's `confirm`, with placeholders for names."""
    journaled: bool = True
    label: str = ""
    """Label of the command in the message to the client in control."""
    acts: Acts = "no"
    agent: AgentScope | None = None
    """The least scope with which an agent gets the command as a tool; None: no agent gets it."""
    agent_calls: tuple[str, ...] = ()
    """Those of `calls` that are tools; empty: the first one."""

    def full_agent_calls(self) -> tuple[str, ...]:
        """`METHOD /path` of the calls that are tools of agents."""
        if self.agent is None:
            return ()
        return tuple(_full(call) for call in self.agent_calls or self.calls[:1])

    def full_calls(self) -> tuple[str, ...]:
        """`METHOD /path` of the application."""
        return tuple(_full(call) for call in self.calls)

    def openapi_fields(self) -> dict[str, object]:
        """The row as `x-authority` of the OpenAPI description."""
        return {
            "command": self.name,
            "permission": self.permission,
            "control": self.control,
            "vehicles": self.vehicles or None,
            "confirmed": self.confirmed,
            "confirm": self.confirm_text,
            "journaled": self.journaled,
            "acts": self.acts,
            "agent": self.agent,
        }

    def confirmation_text(self, **names: str) -> str:
        """The required text of `confirm` for these names."""
        assert self.confirm_text is not None
        return self.confirm_text.format(**names)

    def require_confirmation(self, confirmation: str, **names: str) -> None:
        """Checks the confirmation before anything is sent.

        Raises:
            InvalidRequest: the confirmation is a different text.
        """
        expected = self.confirmation_text(**names)
        if confirmation != expected:
            raise InvalidRequest(
                "confirm",
                "The confirmation is not the required text; nothing was sent.",
                remedy=f"Send exactly {expected!r}.",
            )


ALL_OF_MISSION = "the vehicle, every vehicle that flies the mission together with it"


def _full(call: str) -> str:
    method, path = call.split(" ", 1)
    return f"{method} {path[1:]}" if path.startswith("//") else f"{method} {API}{path}"


def _view(name: str, *calls: str, tools: tuple[str, ...] = ()) -> Command:
    """`tools`: those of the calls that agents have."""
    return Command(name, "view", calls, journaled=False, agent="read" if tools else None, agent_calls=tools)


def _flight(
    name: str,
    *calls: str,
    vehicles: str = "the vehicle",
    confirmed: bool = False,
    confirm_text: str | None = None,
    acts: Acts = "moves",
    agent: AgentScope | None = None,
) -> Command:
    return Command(name, "fly", calls, "lease", vehicles, confirmed, confirm_text, acts=acts, agent=agent)


def _stop(
    name: str,
    label: str,
    *calls: str,
    confirm_text: str | None = None,
    agent: AgentScope | None = None,
) -> Command:
    return Command(
        name,
        "stop",
        calls,
        "open",
        "the vehicle",
        confirmed=confirm_text is not None,
        confirm_text=confirm_text,
        label=label,
        acts="stops",
        agent=agent,
    )


def _gimbal(action: str) -> Command:
    return Command(
        f"gimbal/{action}", "payload", (f"POST /vehicles/{{v}}/gimbal/{action}",), "lease", "the vehicle"
    )


def _configuration(name: str, call: str) -> Command:
    return Command(name, "configure", (call,), "lease", "the vehicle")


def _control(
    action: str,
    *other_calls: str,
    confirmed: bool = False,
    journaled: bool = True,
    agent: AgentScope | None = None,
) -> Command:
    calls = (f"POST /vehicles/{{v}}/control/{action}", *other_calls)
    return Command(
        f"control/{action}",
        "control",
        calls,
        "changes",
        "the vehicle",
        confirmed,
        journaled=journaled,
        agent=agent,
    )


ALL: tuple[Command, ...] = (
    # flying
    _flight("arm", "POST /vehicles/{v}/arm", confirmed=True, agent="simulated"),
    _flight("disarm", "POST /vehicles/{v}/disarm", confirmed=True, acts="stops", agent="simulated"),
    _flight("takeoff", "POST /vehicles/{v}/takeoff", confirmed=True, agent="simulated"),
    _flight("land", "POST /vehicles/{v}/land", confirmed=True, acts="stops", agent="simulated"),
    _flight("rtl", "POST /vehicles/{v}/rtl", confirmed=True, acts="stops", agent="simulated"),
    _flight("mode", "POST /vehicles/{v}/mode"),
    _flight("goto", "POST /vehicles/{v}/goto", confirmed=True, agent="simulated"),
    _flight("altitude", "POST /vehicles/{v}/altitude", confirmed=True, agent="simulated"),
    _flight("heading", "POST /vehicles/{v}/heading", confirmed=True, agent="simulated"),
    _flight("speed", "POST /vehicles/{v}/speed", confirmed=True, agent="simulated"),
    _flight("orbit", "POST /vehicles/{v}/orbit", confirmed=True, agent="simulated"),
    _flight("home", "POST /vehicles/{v}/home", confirmed=True, acts="no"),
    _flight("autotune/start", "POST /vehicles/{v}/autotune", confirmed=True),
    _flight(
        "mission/upload",
        "POST /vehicles/{v}/mission/upload",
        confirmed=True,
        acts="no",
        agent="simulated",
    ),
    _flight(
        "mission/clear",
        "DELETE /vehicles/{v}/mission",
        confirmed=True,
        confirm_text="vehicle {vehicle} loses the mission that it flies",
        acts="no",
    ),
    _flight("mission/start", "POST /vehicles/{v}/mission/start", confirmed=True, agent="simulated"),
    _flight("mission/resume", "POST /vehicles/{v}/mission/resume", confirmed=True, agent="simulated"),
    _flight("offboard/start", "POST /vehicles/{v}/offboard/start", confirmed=True, agent="simulated"),
    _flight(
        "offboard/setpoint",
        "POST /vehicles/{v}/offboard/setpoint",
        "WS /vehicles/{v}/offboard/stream",
        "WS /vehicles/{v}/offboard/stream setpoint",
        "POST /groups/{g}/setpoints",
        vehicles="the vehicle, every member of the group",
        acts="no",
        agent="simulated",
    ),
    _flight(
        "manual_control",
        "WS /vehicles/{v}/manual_control/stream",
        "WS /vehicles/{v}/manual_control/stream sticks",
        acts="no",
    ),
    _flight("offboard/stop", "POST /vehicles/{v}/offboard/stop", acts="stops", agent="simulated"),
    _flight("offboard/avoidance", "PUT /vehicles/{v}/offboard/avoidance", acts="no"),
    _flight(
        "offboard_mission/start",
        "POST /vehicles/{v}/offboard_mission/start",
        "POST /offboard_missions/start",
        vehicles=ALL_OF_MISSION,
        confirmed=True,
        agent="simulated",
    ),
    _flight(
        "offboard_mission/pause",
        "POST /vehicles/{v}/offboard_mission/pause",
        vehicles=ALL_OF_MISSION,
        acts="stops",
        agent="simulated",
    ),
    _flight(
        "offboard_mission/resume",
        "POST /vehicles/{v}/offboard_mission/resume",
        vehicles=ALL_OF_MISSION,
        confirmed=True,
    ),
    _flight(
        "offboard_mission/skip",
        "POST /vehicles/{v}/offboard_mission/skip",
        vehicles=ALL_OF_MISSION,
        confirmed=True,
    ),
    _flight("offboard_mission/go_on", "POST /vehicles/{v}/offboard_mission/go_on", vehicles=ALL_OF_MISSION),
    _flight(
        "offboard_mission/abort",
        "POST /vehicles/{v}/offboard_mission/abort",
        vehicles=ALL_OF_MISSION,
        confirmed=True,
        acts="stops",
        agent="simulated",
    ),
    _flight("mission_modes/register", "POST /vehicles/{v}/mission_modes/register", acts="no"),
    _flight("mission_modes/unregister", "POST /vehicles/{v}/mission_modes/unregister", acts="no"),
    _flight("group/start", "POST /groups", vehicles="every member", confirmed=True),
    # allowed to all clients: anyone who sees a danger may stop a vehicle
    _stop(
        "hold", "Hold", "POST /vehicles/{v}/hold", "POST /hold", "POST /groups/{g}/hold", agent="simulated"
    ),
    _stop("autotune/end", "End autotune", "DELETE /vehicles/{v}/autotune"),
    _stop(
        "land_now",
        "Land now",
        "POST /vehicles/{v}/land_now",
        confirm_text="vehicle {vehicle} lands now",
        agent="simulated",
    ),
    _stop(
        "kill", "Stop motors", "POST /vehicles/{v}/kill", confirm_text="motors stop, vehicle {vehicle} falls"
    ),
    # payload
    *(
        _gimbal(action)
        for action in ("take", "release", "angles", "rates", "roi", "roi/clear", "pose", "try", "module")
    ),
    Command("camera/picture", "payload", ("POST /vehicles/{v}/camera/picture",), "lease", "the vehicle"),
    # settings of a vehicle
    _configuration("param", "PUT /vehicles/{v}/params/{name}"),
    _configuration("param_changes/apply", "POST /vehicles/{v}/param_changes/apply"),
    Command(
        "restart",
        "fly",
        ("POST /vehicles/{v}/restart",),
        "lease",
        "the vehicle",
        confirmed=True,
        confirm_text="vehicle {vehicle} restarts",
    ),
    Command("shell", "fly", ("POST /vehicles/{v}/shell",), "lease", "the vehicle"),
    Command(
        "mavlink/send",
        "fly",
        ("POST /vehicles/{v}/mavlink/send",),
        "lease",
        "the vehicle",
        confirmed=True,
        confirm_text="{message} is sent unchecked to vehicle {vehicle}",
    ),
    _configuration("offboard/limits", "PUT /vehicles/{v}/offboard/limits"),
    _configuration("offboard/failsafe", "PUT /vehicles/{v}/offboard/failsafe"),
    Command("params/refresh", "configure", ("POST /vehicles/{v}/params/refresh",), journaled=False),
    Command("mission/download", "configure", ("POST /vehicles/{v}/mission/download",), journaled=False),
    Command("readiness/check", "configure", ("POST /vehicles/{v}/readiness/check",), journaled=False),
    Command(
        "logs/download",
        "configure",
        ("POST /vehicles/{v}/logs/{number}/download", "POST /vehicles/{v}/logs/after_landing"),
        "not_anothers",
        "the vehicle",
    ),
    Command(
        "logs/decline",
        "configure",
        ("DELETE /vehicles/{v}/logs/after_landing",),
        "not_anothers",
        "the vehicle",
    ),
    Command("logs/after_landing", "configure", ("POST /logs_after_landing",)),
    Command("logs/stream", "configure", ("POST /vehicles/{v}/logs/stream",), "lease", "the vehicle"),
    Command("logs/stop_stream", "configure", ("DELETE /vehicles/{v}/logs/stream",), "lease", "the vehicle"),
    Command(
        "logs/erase",
        "configure",
        ("POST /vehicles/{v}/logs/erase",),
        "lease",
        "the vehicle",
        confirmed=True,
        confirm_text="all logs of vehicle {vehicle} are erased",
    ),
    # above `configure`: what PX4 runs at its start may do all that its console may
    Command(
        "files/put",
        "fly",
        ("POST /vehicles/{v}/files/put",),
        "lease",
        "the vehicle",
        confirmed=True,
        confirm_text="{path} is written on vehicle {vehicle}",
    ),
    Command(
        "files/remove",
        "fly",
        ("POST /vehicles/{v}/files/remove",),
        "lease",
        "the vehicle",
        confirmed=True,
        confirm_text="{path} is removed from vehicle {vehicle}",
    ),
    Command("files/make_folder", "fly", ("POST /vehicles/{v}/files/make_folder",), "lease", "the vehicle"),
    Command("files/get", "configure", ("POST /vehicles/{v}/files/get",), "not_anothers", "the vehicle"),
    # control
    _control("take", confirmed=True, agent="simulated"),
    _control("request", agent="simulated"),
    _control("grant"),
    _control("deny"),
    _control("release", "POST /me/leave", agent="simulated"),
    _control("renew", journaled=False),
    # the station
    Command(
        "links/add", "station", ("POST /links",), "not_anothers", "every vehicle, where the link forwards"
    ),
    Command(
        "links/remove",
        "station",
        ("DELETE /links/{name}",),
        "not_anothers",
        "every vehicle connected over the link",
        confirm_text="link {link} closes, vehicle {vehicles} in flight loses its last link",
    ),
    Command("guards/resume", "control", ("POST /guards/{name}/resume",)),
    Command("agents/resume", "control", ("POST /agents/{name}/resume",)),
    Command(
        "agents/allow_flight",
        "fly",
        ("POST /agents/requests/{request}/allow",),
        "not_anothers",
        "the vehicle",
        confirmed=True,
    ),
    Command("agents/refuse_flight", "control", ("POST /agents/requests/{request}/refuse",)),
    Command("vehicles/remove", "station", ("DELETE /vehicles/{v}",), "not_anothers", "the vehicle"),
    Command("maps/choose", "station", ("PUT /map_sources/chosen",)),
    Command("maps/add_source", "station", ("POST /map_sources",)),
    Command("maps/read_service", "station", ("POST /map_sources/wmts_layers",)),
    Command("maps/remove_source", "station", ("DELETE /map_sources/{s}",)),
    Command("maps/save_region", "station", ("POST /map_regions",)),
    Command("elevation/choose", "station", ("PUT /elevation/sources/chosen",)),
    Command("elevation/add_source", "station", ("POST /elevation/sources",)),
    Command("elevation/remove_source", "station", ("DELETE /elevation/sources/{s}",)),
    Command("elevation/save_region", "station", ("POST /elevation/regions",)),
    # recordings
    Command("replays/open", "replay", ("POST /replays",)),
    Command("replays/change", "replay", ("POST /replays/{name}",), journaled=False),
    Command("replays/close", "replay", ("DELETE /replays/{name}",)),
    Command("flights/add", "replay", ("POST /flights/uploads",)),
    Command(
        "flights/add_part",
        "replay",
        ("POST /flights/uploads/{u}", "DELETE /flights/uploads/{u}"),
        journaled=False,
    ),
    Command("flights/name", "replay", ("POST /flights/{f}/name",)),
    Command("flights/join", "replay", ("POST /flights/{f}/parts",)),
    Command(
        "flights/delete",
        "replay",
        ("DELETE /flights/{f}",),
        confirmed=True,
        confirm_text="flight {flight} is deleted",
    ),
    # plans
    Command("plans/create", "plan", ("POST /plans",), agent="plan"),
    Command("plans/save", "plan", ("PUT /plans/{plan}",), agent="plan"),
    Command("plans/delete", "plan", ("DELETE /plans/{plan}",)),
    Command("model/keep", "plan", ("PUT /vehicles/{v}/model",)),
    Command("model/forget", "plan", ("DELETE /vehicles/{v}/model",)),
    Command("dry_runs/start", "plan", ("POST /dry_runs",), agent="plan"),
    Command("proofs/start", "plan", ("POST /proofs",)),
    # operations
    Command(
        "operations/cancel",
        "configure",
        ("DELETE /operations/{o}",),
        "not_anothers",
        "the operation's vehicle, unless the caller started it",
    ),
    # reading
    _view(
        "vehicles",
        "GET /vehicles",
        "GET /vehicles/{v}",
        "GET /vehicles/{v}/history",
        "GET /vehicles/{v}/messages",
        "GET /vehicles/{v}/control",
        "GET /vehicles/{v}/offboard",
        "GET /vehicles/{v}/offboard_mission",
        "GET /vehicles/{v}/offboard_mission/flown",
        "GET /vehicles/{v}/mission_modes",
        "GET /vehicles/{v}/offboard/limits",
        "GET /vehicles/{v}/gimbal",
        "GET /vehicles/{v}/mission",
        "GET /vehicles/{v}/mission/plan",
        "GET /vehicles/{v}/mission/flown",
        "GET /vehicles/{v}/readiness",
        "GET /vehicles/{v}/modes",
        "GET /vehicles/{v}/model",
        "GET /vehicles/{v}/ros2/topics",
        "GET /logs_after_landing",
        "GET /vehicles/{v}/logs",
        "GET /vehicles/{v}/logs/{file}",
        "GET /vehicles/{v}/files/{file}",
        "GET /vehicles/{v}/shell",
        "GET /vehicles/{v}/mavlink",
        "GET /vehicles/{v}/mavlink/series",
        "GET /mavlink/messages",
        "GET /mavlink/messages/{name}",
        "GET /vehicles/{v}/manual_control",
        "GET /vehicles/{v}/params",
        "GET /vehicles/{v}/params/{name}",
        "GET /vehicles/{v}/param_changes",
        "GET /vehicles/{v}/param_file",
        "GET /vehicles/{v}/gimbal/setup",
        "GET /vehicles/{v}/autotune",
        "GET /groups",
        "GET /groups/{g}",
        tools=(
            "GET /vehicles",
            "GET /vehicles/{v}",
            "GET /vehicles/{v}/messages",
            "GET /vehicles/{v}/control",
            "GET /vehicles/{v}/readiness",
            "GET /vehicles/{v}/mission",
            "GET /vehicles/{v}/offboard",
            "GET /vehicles/{v}/offboard_mission",
            "GET /vehicles/{v}/params/{name}",
        ),
    ),
    _view("files/list", "POST /vehicles/{v}/files/list"),
    _view("param_changes/review", "POST /vehicles/{v}/param_changes/review"),
    _view(
        "plans",
        "GET /plans",
        "GET /plans/{plan}",
        "GET /plans/{plan}/versions",
        "GET /plans/schema/{kind}",
        "POST /plans/check",
        "POST /plans/convert",
        "POST /plans/divide",
        "POST /plans/import",
        "POST /plans/insert",
        "POST /plans/export",
        "POST /plans/pattern",
        "POST /plans/ground",
        "POST /plans/table",
        "GET /elevation",
        "GET /dry_runs/{d}",
        "GET /proofs/{p}",
        "POST /vehicles/{v}/mission/compare",
        tools=(
            "GET /plans",
            "GET /plans/{plan}",
            "POST /plans/check",
            "GET /dry_runs/{d}",
        ),
    ),
    _view("flights/rerun", "POST /flights/{f}/rerun"),
    _view("vehicles/futures", "POST /vehicles/{v}/futures", tools=("POST /vehicles/{v}/futures",)),
    _view(
        "operations",
        "GET /operations",
        "GET /operations/{o}",
        tools=("GET /operations", "GET /operations/{o}"),
    ),
    _view("telemetry", "WS /telemetry", "WS /telemetry subscribe"),
    _view(
        "recordings",
        "GET /recordings",
        "GET /recordings/{name}",
        "GET /recordings/{name}/index",
        "GET /replays",
        "GET /replays/{name}",
        "GET /replays/{name}/index",
        "GET /flights",
        "GET /flights/{f}",
        "GET /flights/{f}/joined",
        "GET /flights/{f}/beside",
        "GET /flights/{f}/model",
        "GET /flights/{f}/file",
        "GET /flights/{f}/series",
        "GET /flights/{f}/spectrum",
        "GET /flights/{f}/loops",
        "GET /flights/{f}/findings",
        "GET /flights/{f}/table",
        "GET /flights/{f}/export",
        tools=(
            "GET /flights",
            "GET /flights/{f}",
            "GET /flights/{f}/findings",
        ),
    ),
    _view(
        "maps",
        "GET /maps",
        "GET /maps/{name}",
        "GET /maps/{name}/{zoom}/{x}/{y}",
        "GET /map_sources",
        "GET /map_sources/{s}/{zoom}/{x}/{y}",
        "POST /map_regions/size",
        "GET /elevation/sources",
        "GET /elevation/tiles/{version}/{zoom}/{x}/{y}",
        "POST /elevation/regions/size",
    ),
    # of the page only, and each user's own: no vehicle, and nothing that others see
    _view("settings", "GET /settings", "POST /settings", "PUT /settings"),
    _view(
        "server",
        "GET /health",
        "GET /version",
        "GET /simulator",
        "GET /warnings",
        "GET /links",
        "GET /guards",
        "GET /guards/table",
        "GET /agents",
        "GET /journal",
        "GET /me",
        tools=(
            "GET /warnings",
            "GET /journal",
        ),
    ),
    _view(
        "scene",
        "GET //scene/",
        "POST //scene/view/{token}",
        "POST //scene/view/{token}/click",
        "WS //scene/",
        "WS //scene/ ViewerCameraMessage",
        "WS //scene/ TransformControlsUpdateMessage",
        "WS //scene/ TransformControlsDragEndMessage",
    ),
    Command(
        "page",
        None,
        (
            "GET //",
            "GET //docs",
            "GET //docs/",
            "GET //docs/reference.js",
            "GET //docs/reference.css",
            "GET /docs",
            "GET /openapi.json",
        ),
        journaled=False,
    ),
    # each call of a tool has its own line in the journal
    Command("agents/call", None, ("POST //mcp",), journaled=False),
)

BY_NAME: dict[str, Command] = {command.name: command for command in ALL}
BY_CALL: dict[str, Command] = {call: command for command in ALL for call in command.full_calls()}
"""Commands by `METHOD /path`, with the names of the path's variables."""


def _agent_calls_text(command: Command) -> str:
    if not command.agent_calls:
        return ""
    return ": " + ", ".join(f"`{call}`" for call in command.agent_calls)


def table() -> str:
    """The rows as Markdown, for `docs/authority.md`."""
    lines = [
        "| command | calls | permission | control | of | confirmed on the page | `confirm` | journal "
        "| agents |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for c in ALL:
        cells = (
            f"`{c.name}`",
            ", ".join(f"`{call.replace('//', '/')}`" for call in c.calls),
            f"`{c.permission}`" if c.permission is not None else "none",
            CONTROL_TEXT[c.control],
            c.vehicles or "–",
            "yes" if c.confirmed else "no",
            f"`{c.confirm_text}`" if c.confirm_text is not None else "–",
            "yes" if c.journaled else "no",
            f"`{c.agent}`{_agent_calls_text(c)}" if c.agent is not None else "–",
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"
