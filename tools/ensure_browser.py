"""Finds the Chromium for the browser tests, or prints how to install it.

Debian's chromium is used if it is installed; as root it is installed without asking, for CI machines.
Otherwise Playwright's own build is downloaded.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

DEBIAN_NAMES = ("chromium", "chromium-browser", "google-chrome")


def installed_chromium() -> str | None:
    """The path of the machine's own Chromium, if there is one."""
    return next((path for name in DEBIAN_NAMES if (path := shutil.which(name))), None)


def main() -> int:
    if installed_chromium():
        return 0
    if shutil.which("apt-get") and os.geteuid() == 0:
        print("installing Debian's chromium for the browser tests …", file=sys.stderr)
        for step in (["update", "-qq"], ["install", "-y", "-qq", "chromium"]):
            subprocess.run(["apt-get", *step], stdout=subprocess.DEVNULL, check=False)
        if installed_chromium():
            return 0
    print("fetching Playwright's Chromium for the browser tests …", file=sys.stderr)
    if (
        subprocess.run([sys.executable, "-m", "playwright", "install", "chromium"], check=False).returncode
        == 0
    ):
        return 0
    print("The browser tests need Chromium. Run: sudo apt-get install chromium", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
