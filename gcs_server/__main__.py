"""`python -m gcs_server` is `gcs`."""

import sys

from gcs_server.cli import main

if __name__ == "__main__":
    sys.exit(main())
