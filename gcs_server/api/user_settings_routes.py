"""Routes of the page's settings of each user."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Query, Response

from gcs_server.api.principals import PrincipalDep
from gcs_server.api.problems import RESPONSES
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import Station, StationDep
from gcs_server.api.user_settings_models import UserSettingsFile, UserSettingsView, UserSettingValues
from gcs_server.control.principal import Principal
from gcs_server.mavlink.dialect import MAV_SEVERITY_DEBUG
from gcs_server.storage.user_settings import KIND, VERSION, current_settings, user_name

router = Routes(tags=["station"], responses=RESPONSES)


async def _user(
    user: Annotated[
        str, Query(max_length=100, description="Name of the user; empty: all who have given no name.")
    ] = "",
) -> str:
    return user_name(user)


UserDep = Annotated[str, Depends(_user)]


@router.get("/settings", response_model=UserSettingsView)
async def read_settings(user: UserDep, station: StationDep) -> Response:
    """The settings of a user, also as the file for an export."""
    return _view(station, user)


@router.post("/settings", response_model=UserSettingsView)
async def change_settings(
    body: UserSettingValues, user: UserDep, station: StationDep, principal: PrincipalDep
) -> Response:
    """Sets some values of a user; null: the default again. The other values stay."""
    changes = body.model_dump(mode="json", include=body.model_fields_set)
    await station.user_settings.change(user, changes)
    return _changed(station, user, principal)


@router.put("/settings", response_model=UserSettingsView)
async def import_settings(
    body: UserSettingsFile, user: UserDep, station: StationDep, principal: PrincipalDep
) -> Response:
    """Replaces all values of a user by those of a file. A file of a newer version, of another kind, or with a
    wrong value is refused, and nothing changes."""
    await station.user_settings.replace(user, current_settings(body.kind, body.version, body.settings))
    return _changed(station, user, principal)


def _changed(station: Station, user: str, principal: Principal) -> Response:
    """Tells the other browsers of the user."""
    text = f"{principal.name} changed the settings of {user or 'all without a name'}."
    station.fleet.events.add(
        "settings_changed",
        station.clock.unix_s(),
        text,
        severity=MAV_SEVERITY_DEBUG,
        data={"user": user, "client_key": principal.key},
        stored=False,
    )
    return _view(station, user)


def _view(station: Station, user: str) -> Response:
    settings = station.user_settings.get(user)
    return json_response({"kind": KIND, "version": VERSION, "user": user, "settings": settings})
