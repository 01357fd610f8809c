"""The fake station, for the tests beside it (each test module is imported on its own)."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
