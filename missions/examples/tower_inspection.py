"""Inspect a tower from all sides, with the gimbal pointed at the tower: `python -m
missions.examples.tower_inspection`.

Start the ground station with a camera on the simulated vehicle: `make run ARGS="--sim-args=--camera"`.
"""

from missions.examples.fly_document import main

if __name__ == "__main__":
    main("Inspect a tower 30 m north of the start, and land.", "tower_inspection.yaml", "tower_inspection")
