"""The page's settings of each user: kept through restarts, changed in parts, exported and imported; wrong
files are refused with the field's name and change nothing."""

import errno
import json

import pytest

from gcs_server.errors import InvalidRequest
from gcs_server.storage import records, user_settings
from gcs_server.storage.user_settings import VERSION, current_settings
from tests.support.api_client import api_client

PATH = "/api/v1/settings"
FAVOURITES = [f"PARAM_{number}" for number in range(200)]


@pytest.fixture
def client(tmp_path):
    with api_client(tmp_path) as client:
        yield client


def settings(client, user=""):
    response = client.get(PATH, params={"user": user})
    assert response.status_code == 200, response.text
    return response.json()["settings"]


def change(client, values, user=""):
    return client.post(PATH, params={"user": user}, json=values)


def imported(client, content, user=""):
    return client.put(PATH, params={"user": user}, json=content)


def test_each_user_has_settings_that_stay_through_a_restart(tmp_path):
    with api_client(tmp_path) as client:
        assert settings(client) == {}
        assert change(client, {"theme": "dark", "units": {"height": "ft"}}, "Anna").status_code == 200
        assert change(client, {"theme": "light"}).status_code == 200
        assert change(client, {"single_keys": False, "theme": None}, "anna ").status_code == 200
    with api_client(tmp_path) as client:
        assert settings(client, "Anna") == {"units": {"height": "ft"}, "single_keys": False}
        assert settings(client) == {"theme": "light"}
        assert settings(client, "Bert") == {}


def test_layouts_of_plots_are_kept_and_bounded(client):
    layout = {
        "name": "Landing",
        "panes": [
            {
                "fields": ["vehicle_attitude:0/q[0]", "abs({a:0/b})"],
                "right_axis": ["abs({a:0/b})"],
                "spectrum": False,
            },
            {"fields": ["c:0/d"], "spectrum": True},
        ],
        "window_s": 30.0,
    }
    assert change(client, {"plot_layouts": [layout]}).status_code == 200
    assert settings(client)["plot_layouts"] == [layout]
    for wrong, place in (
        ({**layout, "panes": [{"fields": ["a:0/b"]}] * 9}, "panes"),
        ({**layout, "panes": [{"fields": ["a:0/b"] * 9}]}, "panes.0.fields"),
        ({**layout, "panes": [{"fields": [""]}]}, "panes.0.fields.0"),
        ({**layout, "panes": [["a:0/b"] * 9]}, "panes.0.fields"),
        ({**layout, "panes": [3]}, "panes.0"),
        ({**layout, "name": ""}, "name"),
        ({**layout, "window_s": 0}, "window_s"),
    ):
        answer = change(client, {"plot_layouts": [wrong]})
        assert (answer.status_code, place in answer.json()["field"]) == (422, True), answer.text
    assert change(client, {"plot_layouts": [layout] * 41}).status_code == 422
    assert settings(client)["plot_layouts"] == [layout]
    earlier = {**layout, "panes": [["c:0/d"]]}
    assert change(client, {"plot_layouts": [earlier]}).status_code == 200
    (kept,) = settings(client)["plot_layouts"]
    assert kept["panes"] == [{"fields": ["c:0/d"], "spectrum": False}]


def test_what_is_exported_can_be_imported_by_another_user(client):
    change(client, {"param_favourites": FAVOURITES, "default_altitudes": {"takeoff_m": 20.5}}, "Anna")
    change(client, {"theme": "dark"}, "Bert")
    exported = client.get(PATH, params={"user": "Anna"}).json()
    assert (exported["kind"], exported["version"], exported["user"]) == ("gcs-settings", VERSION, "Anna")
    assert imported(client, exported, "Bert").status_code == 200
    assert settings(client, "Bert") == settings(client, "Anna") == exported["settings"]


def file_with(**values):
    return {"kind": "gcs-settings", "version": VERSION, "settings": values}


WRONG_FILES = [
    ({"settings": {}}, "kind"),
    (file_with() | {"kind": "plan"}, "kind"),
    (file_with() | {"version": VERSION + 1}, "version"),
    (file_with() | {"version": 0}, "version"),
    (file_with() | {"version": True}, "version"),
    (file_with() | {"settings": []}, "settings"),
    (file_with(colour=1), "settings.colour"),
    (file_with(units={"speed": "ft"}), "settings.units.speed"),
    (file_with(default_altitudes={"takeoff_m": 500}), "settings.default_altitudes.takeoff_m"),
    (file_with(param_favourites=["<script>"]), "settings.param_favourites.0"),
    (file_with(param_favourites=[*FAVOURITES, "MORE"]), "settings.param_favourites"),
]


@pytest.mark.parametrize(("file", "field"), WRONG_FILES)
def test_a_wrong_file_is_refused_with_the_name_of_the_field_and_changes_nothing(client, file, field):
    change(client, {"theme": "dark"})
    refused = imported(client, file)
    assert refused.status_code == 422
    assert refused.json()["field"] == field, refused.text
    assert settings(client) == {"theme": "dark"}


def test_a_file_of_an_older_version_is_brought_up_to_date_and_a_newer_one_is_refused_in_words(monkeypatch):
    monkeypatch.setattr(user_settings, "VERSION", 3)
    monkeypatch.setattr(
        user_settings,
        "UPGRADES",
        {1: lambda old: {"theme": old["colours"]}, 2: lambda old: old | {"single_keys": False}},
    )
    assert current_settings("gcs-settings", 1, {"colours": "dark"}) == {"theme": "dark", "single_keys": False}
    assert current_settings("gcs-settings", 3, {"theme": "dark"}) == {"theme": "dark"}
    with pytest.raises(InvalidRequest, match=r"newer version of this server \(4; this one knows 3\)"):
        current_settings("gcs-settings", 4, {})


@pytest.mark.parametrize(
    "content", ["{", "[]", json.dumps({"kind": "gcs-settings", "version": 99, "settings": {}})]
)
def test_a_stored_file_that_cannot_be_read_is_kept_and_named(tmp_path, content):
    with api_client(tmp_path) as client:
        change(client, {"theme": "dark"}, "Anna")
    (path,) = (tmp_path / "settings").iterdir()
    path.write_text(content)
    with api_client(tmp_path) as client:
        refused = change(client, {"theme": "light"}, "Anna")
        assert refused.status_code == 409
        assert str(path) in refused.json()["detail"]
        assert client.get(PATH, params={"user": "Anna"}).status_code == 409
        assert str(path) in json.dumps(client.get("/api/v1/warnings").json())
        assert change(client, {"theme": "light"}, "Bert").status_code == 200
    assert path.read_text() == content


def test_a_full_disk_is_said_and_nothing_changes(tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    with api_client(tmp_path) as client:
        change(client, {"theme": "dark"}, "Anna")
        with monkeypatch.context() as patched:
            patched.setattr(records, "replace_file", full)
            for user in ("Anna", "Bert"):
                refused = change(client, {"theme": "light"}, user)
                assert refused.status_code >= 400
                assert "No space left" in refused.json()["detail"]
        assert (settings(client, "Anna"), settings(client, "Bert")) == ({"theme": "dark"}, {})


def test_the_number_of_users_is_limited(client, monkeypatch):
    monkeypatch.setattr(user_settings, "MAX_USERS", 2)
    codes = [change(client, {"theme": "dark"}, user).status_code for user in ("a", "b", "c", "a")]
    assert codes == [200, 200, 409, 200]


def test_other_browsers_hear_of_a_change(client):
    with client.websocket_connect("/api/v1/telemetry", headers={"host": "localhost"}) as socket:
        assert socket.receive_json()["type"] == "hello"
        change(client, {"theme": "dark"}, "Anna")
        while (frame := socket.receive_json()).get("event", {}).get("kind") != "settings_changed":
            pass
    assert frame["event"]["user"] == "Anna"
