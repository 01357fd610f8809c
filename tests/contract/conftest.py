"""The fake station of the simulator's own tests, and the recorded dialogues."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "unit" / "vehicle_sim"))
sys.path.insert(0, str(Path(__file__).resolve().parent))
