"""The server's settings, from the command line, the environment, a file, and defaults, in this order of
priority."""

from __future__ import annotations

import ipaddress
import os
import re
import shlex
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, cast, get_args

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    SecretStr,
    ValidationError,
    field_validator,
    model_validator,
)

from gcs_server.errors import InvalidRequest
from gcs_server.storage.folder import DataFolder, default_folder
from gcs_server.storage.token import TOKEN_RULE, is_well_formed, load_or_create_token

AgentScope = Literal["read", "plan", "simulated", "fly"]
"""What an agent may do (docs/how-to-give-an-agent-a-simulator.md); each scope includes those before it."""
AGENT_SCOPES: tuple[AgentScope, ...] = get_args(AgentScope)
AGENT_NAME = re.compile(r"[a-z0-9][a-z0-9-]{0,31}")
SETTINGS_SCHEMA_VERSION = 1
ENVIRONMENT_PREFIX = "GCS_"
LIST_NAMES = frozenset({"links", "guards", "agents", "trusted_proxies"})
SECRET_NAMES = frozenset({"token"})


class Settings(BaseModel):
    """All settings of a server."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    host: str = Field(default="127.0.0.1", description="Address to listen on.")
    port: int = Field(
        default=8080, ge=0, le=65535, description="Port of the page and the API; 0: any free port."
    )
    links: tuple[str, ...] = Field(
        default=("udpin://127.0.0.1:14550",), description="Links to open, as URLs."
    )
    guards: tuple[str, ...] = Field(
        default=(), description="Guarded links of programs to open, as URLs (docs/how-to-guard-a-program.md)."
    )
    agents: tuple[str, ...] = Field(
        default=(),
        description="Agents and their scopes, as `name=read`, plan, simulated or fly "
        "(docs/how-to-give-an-agent-a-simulator.md).",
    )
    agent_calls_per_min: int = Field(
        default=120, ge=1, le=6000, description="Calls that each agent may make per minute."
    )
    sim: int = Field(default=1, ge=0, le=50, description="Number of simulated vehicles to start.")
    px4: bool = Field(
        default=False, description='Whether the simulated vehicles are real PX4s (`sim = "px4:3"`).'
    )
    px4_path: Path | None = Field(
        default=None, description="The PX4 to simulate with: a build folder, or the program px4."
    )
    sim_args: tuple[str, ...] = Field(
        default=(), description="Further arguments of the simulator, such as its ports (`gcs sim --help`)."
    )
    data: Path = Field(default_factory=default_folder, description="Data folder: journal, recordings.")
    token: SecretStr | None = Field(
        default=None,
        description="The token that every client needs. It is not a flag, because other users can see a "
        "process's arguments.",
    )
    token_file: Path | None = Field(
        default=None,
        description="File with the token; if the file is missing, it is created with a random token.",
    )
    trusted_proxies: tuple[str, ...] = Field(
        default=(),
        description="Addresses of https proxies whose X-Forwarded-For and X-Forwarded-Proto headers are "
        "trusted; default: none.",
    )
    system_id: int = Field(default=255, ge=1, le=255, description="MAVLink system id of this server.")
    record: bool = Field(default=True, description="Record each link to a tlog in the data folder.")
    flights_gb: float = Field(
        default=20.0,
        ge=0.01,
        le=100_000,
        description="Size of all recordings and flight logs [GB]; then the oldest are deleted.",
    )
    scene: bool = Field(default=True, description="Serve the 3D view.")
    server_silent_limit_s: float = Field(
        default=1.5,
        ge=0.5,
        le=30,
        description="Time for which the event loop may stall before setpoint streams stop [s].",
    )
    control_lease_s: float = Field(
        default=30.0, ge=5, le=3600, description="Duration of control of a vehicle without renewal [s]."
    )
    control_answer_s: float = Field(
        default=15.0, ge=3, le=120, description="Time to answer a request for control [s]."
    )

    @model_validator(mode="before")
    @classmethod
    def _split_sim(cls, values: dict[str, Any]) -> dict[str, Any]:
        """`px4` or `px4:3` as the number of vehicles: real PX4s."""
        kind, _, count = str(values.get("sim", "")).partition(":")
        return {**values, "sim": count or "1", "px4": True} if kind == "px4" else values

    @field_validator("token")
    @classmethod
    def _check_token(cls, token: SecretStr | None) -> SecretStr | None:
        if token is not None and not is_well_formed(token.get_secret_value()):
            raise ValueError(f"a token has {TOKEN_RULE}")
        return token

    @field_validator("agents")
    @classmethod
    def _check_agents(cls, agents: tuple[str, ...]) -> tuple[str, ...]:
        names: list[str] = []
        for text in agents:
            name, _, scope = text.partition("=")
            if AGENT_NAME.fullmatch(name) is None or scope not in AGENT_SCOPES:
                scopes = ", ".join(AGENT_SCOPES)
                raise ValueError(
                    f"an agent is name=scope: 1 to 32 of a-z 0-9 -, then one of {scopes}; not {text!r}"
                )
            names.append(name)
        if len(set(names)) < len(names):
            raise ValueError("two agents have the same name")
        return agents

    @property
    def agent_scopes(self) -> dict[str, AgentScope]:
        """The scope of each agent by its name."""
        pairs = [each.partition("=") for each in self.agents]
        return {name: cast(AgentScope, scope) for name, _, scope in pairs}

    @property
    def loopback_only(self) -> bool:
        """Whether only this computer can reach the server."""
        if self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False


def read_file(path: Path) -> dict[str, Any]:
    """Reads a TOML file.

    Raises:
        InvalidRequest: the file cannot be read, has another schema version, or an unknown key.
    """
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InvalidRequest("config", f"{path} cannot be read: {error.strerror or error}.") from error
    except tomllib.TOMLDecodeError as error:
        raise InvalidRequest("config", f"{path} is not TOML: {error}.") from error
    version = values.pop("schema_version", None)
    if version != SETTINGS_SCHEMA_VERSION:
        raise InvalidRequest(
            "schema_version",
            f"{path}: schema_version is {version!r}, and this server reads {SETTINGS_SCHEMA_VERSION}.",
            remedy=f"Begin the file with: schema_version = {SETTINGS_SCHEMA_VERSION}",
        )
    unknown = sorted(set(values) - set(Settings.model_fields))
    if unknown:
        raise InvalidRequest(
            unknown[0],
            f"{path}: unknown setting {', '.join(unknown)}.",
            remedy=f"Known settings: {', '.join(sorted(Settings.model_fields))}.",
        )
    return values


def read_environment(environment: Mapping[str, str]) -> dict[str, Any]:
    """Reads `GCS_HOST`, `GCS_PORT`, …; lists are separated by commas or blanks."""
    values: dict[str, Any] = {}
    for name in Settings.model_fields:
        text = environment.get(ENVIRONMENT_PREFIX + name.upper())
        if text is None or text == "":
            continue
        values[name] = tuple(text.replace(",", " ").split()) if name in LIST_NAMES else text
    if isinstance(values.get("sim_args"), str):
        values["sim_args"] = split_arguments(values["sim_args"], "GCS_SIM_ARGS")
    return values


def split_arguments(text: str, source: str) -> tuple[str, ...]:
    """Splits arguments like a shell.

    Raises:
        InvalidRequest: a closing quote is missing.
    """
    try:
        return tuple(shlex.split(text))
    except ValueError as error:
        raise InvalidRequest("sim_args", f"{source}: {error} (given: {text!r}).") from error


def load(
    flags: Mapping[str, Any], environment: Mapping[str, str] | None = None, config: Path | None = None
) -> Settings:
    """Combines all sources.

    Args:
        flags: flags of the command line.
        environment: environment variables; default: the process's environment.
        config: the TOML file; default: the file in `GCS_CONFIG`.

    Raises:
        InvalidRequest: a setting is invalid; the error names the setting and its source.
    """
    env = dict(os.environ) if environment is None else environment
    if config is None and env.get("GCS_CONFIG"):
        config = Path(env["GCS_CONFIG"])
    from_file = read_file(config) if config is not None else {}
    from_env = read_environment(env)
    try:
        return Settings.model_validate({**from_file, **from_env, **flags})
    except ValidationError as error:
        first = error.errors()[0]
        name = str(first["loc"][0])
        if name in flags:
            source = f"--{name.replace('_', '-')}"
        elif name in from_env:
            source = ENVIRONMENT_PREFIX + name.upper()
        else:
            source = f"{name} in {config}"
        if name in SECRET_NAMES:  # kept out of logs and tracebacks
            raise InvalidRequest(name, f"{source}: {first['msg']}.") from None
        raise InvalidRequest(name, f"{source}: {first['msg']} (given: {first['input']!r}).") from error


def agent_tokens_of(settings: Settings) -> dict[str, str]:
    """The token of each agent by its name; missing files of tokens are created.

    Raises:
        StorageError: a token's file cannot be read or created, or has no valid token.
    """
    folder = DataFolder(settings.data)
    if settings.agents:
        folder.agents.mkdir(parents=True, exist_ok=True)
    return {name: load_or_create_token(folder.agent_token(name)) for name in settings.agent_scopes}


def token_of(settings: Settings) -> str | None:
    """The required token; None if no token is required (on loopback, unless a token was set).

    Raises:
        StorageError: the token's file cannot be read or created, or has no valid token.
        InvalidRequest: the token is set twice.
    """
    if settings.token is not None:
        if settings.token_file is not None:
            raise InvalidRequest(
                "token_file", "Both token and token_file are set.", remedy="Leave one of them out."
            )
        return settings.token.get_secret_value()
    if settings.token_file is not None:
        return load_or_create_token(settings.token_file)
    return None if settings.loopback_only else load_or_create_token(DataFolder(settings.data).token)
