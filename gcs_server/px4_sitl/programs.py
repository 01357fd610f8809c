"""Finds a PX4 for software-in-the-loop simulation, and says how one instance of it is started.

Sources, in this order: the path that the operator names (a build folder, a source folder with a build, or a
`px4` program), the program `px4` of PX4's Debian package, the published container image. Folders, variables
and ports are those of PX4's documentation of its pre-built packages (v1.17).
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from gcs_server.errors import GcsError

IMAGE = "px4io/px4-sitl"
"""PX4's published image: SIH, 100 MB."""
ENGINES = ("docker", "podman")
STARTUP_SCRIPT = Path("etc/init.d-posix/rcS")
BUILDS = ("px4_sitl_default", "px4_sitl_sih")
"""Builds of a source folder, in the order of preference."""
ENGINE_TIMEOUT_S = 20.0
AGENTS = ("MicroXRCEAgent", "micro-xrce-dds-agent")
"""Names of the Micro XRCE-DDS Agent: built from source, and as a snap."""
INSTALL = (
    "Install PX4's package (sudo apt install ./px4_*.deb, from PX4's releases), or name a build with "
    "--px4-path, or install docker or podman."
)


class ImageMissing(GcsError):
    """A container engine is there, and the image is not on this computer."""

    def __init__(self, engine: str) -> None:
        super().__init__(
            f"No PX4 is installed, and the image {IMAGE} is not on this computer.",
            remedy=f"Download it (about 100 MB): {engine} pull {IMAGE}",
        )
        self.engine = engine


@dataclass(frozen=True, slots=True)
class Start:
    """How one process is started."""

    command: list[str]
    environment: dict[str, str]
    """In addition to that of this process."""


@dataclass(frozen=True, slots=True)
class Px4Program:
    """A PX4 on this computer."""

    label: str
    """Where it comes from, for people."""
    binary: Path | None
    """The program `px4`, beside whose folder is `etc/`; None: the container image."""
    engine: str = ""
    """The container engine, for the image."""

    def start(self, instance: int, folder: Path, variables: Mapping[str, str]) -> Start:
        """How an instance is started.

        Args:
            instance: from 0; it determines the ports (18570 + instance …) and the system id (instance + 1).
            folder: its working folder, which exists: parameters, plans and logs.
            variables: environment variables for PX4, such as PX4_SIM_MODEL.
        """
        arguments = ["-i", str(instance), "-d"]
        if self.binary is not None:
            etc = self.binary.parent.parent / "etc"
            return Start([str(self.binary), *arguments, "-w", str(folder), str(etc)], dict(variables))
        options = [f"--env={name}={value}" for name, value in variables.items()]
        name = f"gcs-px4-{instance}-{os.getpid()}"
        run = [self.engine, "run", "--rm", "--init", "--network=host", f"--name={name}", *options]
        return Start([*run, IMAGE, *arguments], {})


def find_px4(
    path: Path | None,
    *,
    which: Callable[[str], str | None] = shutil.which,
    run: Callable[[Sequence[str]], bool] | None = None,
) -> Px4Program:
    """The PX4 to start.

    Args:
        path: what the operator names; None: what is installed.
        which: finds a program.
        run: runs a command; returns whether it succeeded.

    Raises:
        ImageMissing: only a container engine is there, without the image.
        GcsError: there is no PX4.
    """
    if path is not None:
        return _named(path.expanduser())
    installed = which("px4")
    if installed is not None:
        binary = Path(installed).resolve()
        if (binary.parent.parent / STARTUP_SCRIPT).is_file():
            return Px4Program(f"installed PX4 ({binary})", binary)
    succeeds = run or _succeeds
    engines = [engine for engine in ENGINES if which(engine) is not None and succeeds([engine, "info"])]
    for engine in engines:
        if succeeds([engine, "image", "inspect", IMAGE]):
            return Px4Program(f"{engine} image {IMAGE}", None, engine)
    if engines:
        raise ImageMissing(engines[0])
    raise GcsError("There is no PX4 on this computer.", remedy=INSTALL)


def find_agent(which: Callable[[str], str | None] = shutil.which) -> str | None:
    """The Micro XRCE-DDS Agent, which connects PX4's topics to ROS 2; None: not installed."""
    return next((found for name in AGENTS if (found := which(name)) is not None), None)


def pull(engine: str) -> bool:
    """Downloads the image, and shows the engine's progress; returns whether it succeeded."""
    return subprocess.run([engine, "pull", IMAGE], check=False).returncode == 0


def _named(path: Path) -> Px4Program:
    folders = [path, *(path / "build" / build for build in BUILDS)]
    candidates = [path] if path.is_file() else [folder / "bin" / "px4" for folder in folders]
    binary = next((each.resolve() for each in candidates if each.is_file()), None)
    if binary is None:
        looked = ", ".join(str(each) for each in candidates)
        raise GcsError(
            f"--px4-path {path}: there is no PX4 here (looked for {looked}).",
            remedy="Name PX4's build folder, as ~/PX4-Autopilot/build/px4_sitl_default, or its program px4. "
            "A source folder is built with: make px4_sitl",
        )
    if not os.access(binary, os.X_OK):
        raise GcsError(f"--px4-path {path}: {binary} cannot be executed.", remedy=f"chmod +x {binary}")
    if not (binary.parent.parent / STARTUP_SCRIPT).is_file():
        raise GcsError(
            f"--px4-path {path}: PX4's start-up script {binary.parent.parent / STARTUP_SCRIPT} is missing.",
            remedy="Name the folder of a whole build for SITL: make px4_sitl",
        )
    return Px4Program(f"PX4 build ({binary.parent.parent})", binary)


def _succeeds(command: Sequence[str]) -> bool:
    try:
        done = subprocess.run(command, check=False, capture_output=True, timeout=ENGINE_TIMEOUT_S)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return done.returncode == 0
