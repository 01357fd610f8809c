"""`gcs key`: keys are read from the standard input and never printed."""

import io
import stat

import pytest

from gcs_server import cli
from gcs_server.cli import main
from gcs_server.mavlink.key_store import KeyStore

KEY = bytes(range(32))


@pytest.fixture
def key_command(tmp_path, monkeypatch, capsys):
    """Runs `gcs key`; checks that it does not print the key; returns exit code, output and errors."""

    def run(*arguments, stdin_text=""):
        monkeypatch.setattr("sys.stdin", io.StringIO(stdin_text))
        code = main(["key", *arguments, "--data", str(tmp_path)])
        out, err = capsys.readouterr()
        assert KEY.hex() not in out + err
        return code, out, err

    run.store = KeyStore(tmp_path / "signing")
    return run


def test_keys_are_added_created_listed_and_removed(key_command):
    assert key_command("list") == (0, "no signing keys\n", "")
    assert key_command("add", "field", stdin_text=KEY.hex() + "\n")[0] == 0
    assert key_command("new", "random")[0] == 0
    assert key_command("add", "sentence", "--passphrase", stdin_text="correct horse battery staple\n")[0] == 0
    assert key_command("list")[1].split() == ["field", "random", "sentence"]
    assert key_command.store.read("field").reveal() == KEY
    assert len({key_command.store.read(name).reveal() for name in ("field", "random", "sentence")}) == 3
    for path in key_command.store._folder.iterdir():
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert key_command("remove", "sentence")[0] == 0
    assert key_command("list")[1].split() == ["field", "random"]


@pytest.mark.parametrize(
    ("arguments", "stdin_text", "expected"),
    [
        (("add", "field"), "", "32 bytes"),
        (("add", "field"), KEY.hex() + "00\n", "32 bytes"),
        (("add", "field", "--passphrase"), "short\n", "12 characters"),
        (("add", "a/b"), KEY.hex(), "is not valid"),
        (("add", KEY.hex()), "", "is not valid"),
        (("new",), "", "needs the key's name"),
        (("remove", "none"), "", "cannot be removed"),
    ],
)
def test_an_error_never_shows_the_key_and_stores_nothing(key_command, arguments, stdin_text, expected):
    code, out, err = key_command(*arguments, stdin_text=stdin_text)
    assert (code, out) == (cli.EXIT_CANNOT_START, "")
    assert expected in err
    assert key_command.store.names() == []


def test_a_key_is_not_overwritten(key_command):
    assert key_command("add", "field", stdin_text=KEY.hex())[0] == 0
    code, _, err = key_command("new", "field")
    assert code == cli.EXIT_CANNOT_START
    assert "already" in err
    assert key_command.store.read("field").reveal() == KEY
