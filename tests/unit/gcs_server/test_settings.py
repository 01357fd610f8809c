"""Settings: priority of flags, environment, file and defaults; errors name the source."""

import pytest

from gcs_server.errors import InvalidRequest
from gcs_server.settings import Settings, load


def test_flags_override_environment_file_and_defaults(tmp_path):
    file = tmp_path / "gcs.toml"
    file.write_text('schema_version = 1\nport = 1000\nhost = "127.0.0.2"\nsim = 3\n')
    settings = load({"port": 3000}, {"GCS_PORT": "2000", "GCS_SIM": "2"}, file)
    assert (settings.port, settings.sim, settings.host) == (3000, 2, "127.0.0.2")
    assert settings.system_id == 255


def test_links_in_the_environment_are_separated_by_commas():
    settings = load({}, {"GCS_LINKS": "udpin://127.0.0.1:1, tcp://h:2"})
    assert settings.links == ("udpin://127.0.0.1:1", "tcp://h:2")


@pytest.mark.parametrize(
    ("text", "field", "expected"),
    [
        ("port = 1\n", "schema_version", "schema_version = 1"),
        ("schema_version = 9\n", "schema_version", "9"),
        ("schema_version = 1\nprot = 1\n", "prot", "prot"),
        ('schema_version = 1\nport = "x"\n', "port", "gcs.toml"),
        ("schema_version = \n", "config", "TOML"),
    ],
)
def test_the_error_about_an_invalid_settings_file_names_the_field(tmp_path, text, field, expected):
    file = tmp_path / "gcs.toml"
    file.write_text(text)
    with pytest.raises(InvalidRequest) as error:
        load({}, {}, file)
    assert error.value.field == field
    assert expected in f"{error.value.message} {error.value.remedy}"


@pytest.mark.parametrize(
    ("flags", "env", "expected"),
    [({"port": 70000}, {}, "--port"), ({}, {"GCS_SIM": "many"}, "GCS_SIM")],
)
def test_the_error_about_an_invalid_setting_names_its_source(flags, env, expected):
    with pytest.raises(InvalidRequest, match=expected):
        load(flags, env)


@pytest.mark.parametrize(
    ("host", "loopback_only"),
    [("127.0.0.1", True), ("localhost", True), ("::1", True), ("0.0.0.0", False), ("example.org", False)],
)
def test_only_a_loopback_host_limits_the_server_to_this_machine(host, loopback_only):
    assert Settings(host=host).loopback_only is loopback_only


def test_the_simulators_arguments_are_split_as_in_a_shell(tmp_path):
    settings = load({}, {"GCS_SIM_ARGS": "--speed 3 --data-dir 'a b'"})
    assert settings.sim_args == ("--speed", "3", "--data-dir", "a b")
    file = tmp_path / "gcs.toml"
    file.write_text('schema_version = 1\nsim_args = ["--speed", "2"]\n')
    assert load({}, {}, file).sim_args == ("--speed", "2")
    with pytest.raises(InvalidRequest) as error:
        load({}, {"GCS_SIM_ARGS": "--data-dir 'a"})
    assert error.value.field == "sim_args"
