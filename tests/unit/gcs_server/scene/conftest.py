"""The fakes, for the tests beside them (each test module is imported on its own)."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
