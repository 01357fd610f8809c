"""Finds the Chromium for the browser tests, or prints how to install it.

The tests use an installed Chromium or Chrome. Without one, this tool installs Debian's chromium if it runs as
root (CI machines); otherwise it downloads Playwright's Chromium.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

EXECUTABLES = ("chromium", "chromium-browser", "google-chrome")


def installed_chromium() -> str | None:
    """The path of the installed Chromium or Chrome; None: not installed."""
    return next((path for name in EXECUTABLES if (path := shutil.which(name))), None)


def main() -> int:
    """Returns 0 if a Chromium is installed, otherwise 1."""
    if installed_chromium():
        return 0
    if shutil.which("apt-get") and os.geteuid() == 0:
        print("installing Debian's chromium for the browser tests …", file=sys.stderr)
        for step in (["update", "-qq"], ["install", "-y", "-qq", "chromium"]):
            subprocess.run(["apt-get", *step], stdout=subprocess.DEVNULL, check=False)
        if installed_chromium():
            return 0
    print("downloading Playwright's Chromium for the browser tests …", file=sys.stderr)
    if (
        subprocess.run([sys.executable, "-m", "playwright", "install", "chromium"], check=False).returncode
        == 0
    ):
        return 0
    print("The browser tests need Chromium. Run: sudo apt-get install chromium", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
