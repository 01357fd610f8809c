"""Layout of the tests: no module imports a test module; shared helpers are in other modules."""

import ast
import multiprocessing
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parent.parent


def imported_modules(path: Path) -> Iterator[str]:
    """The modules that a file imports, also inside functions."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            yield node.module
            yield from (f"{node.module}.{each.name}" for each in node.names if each.name == "conftest")


def is_run_by_pytest(module: str) -> bool:
    """Whether this is the name of a test module or a conftest."""
    name = module.split(".")[-1]
    return name == "conftest" or name.startswith("test_")


def test_no_module_imports_a_test_module_or_a_conftest() -> None:
    wrong_imports = {
        f"{path.relative_to(TESTS)} imports {name}: move the shared code to a module without tests"
        for path in TESTS.rglob("*.py")
        for name in imported_modules(path)
        if is_run_by_pytest(name)
    }
    assert not wrong_imports, "\n".join(sorted(wrong_imports))


def test_an_import_of_a_test_module_is_found(tmp_path: Path) -> None:
    for line in (
        "from tests.e2e.conftest import FAST",
        "from tests.e2e.test_page import story",
        "import tests.e2e.test_page as page",
        "from test_ftp import Client",
        "from tests.e2e import conftest",
        "def later():\n    from tests.e2e.test_page import story",
    ):
        (tmp_path / "module.py").write_text(line, encoding="utf-8")
        assert any(is_run_by_pytest(name) for name in imported_modules(tmp_path / "module.py")), line


def test_a_unit_test_cannot_use_a_socket_or_start_a_process() -> None:
    with socket.socket() as test_socket, pytest.raises(AssertionError, match="move it to tests/integration"):
        test_socket.bind(("127.0.0.1", 0))
    with socket.socket() as test_socket, pytest.raises(AssertionError, match="move it to tests/integration"):
        test_socket.connect(("127.0.0.1", 9))
    with pytest.raises(AssertionError, match="move it to tests/integration"):
        subprocess.Popen([sys.executable, "-V"])
    with pytest.raises(AssertionError, match="move it to tests/integration"):
        multiprocessing.get_context("spawn").Process(target=print).start()
