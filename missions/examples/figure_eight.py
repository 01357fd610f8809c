"""A figure-eight at 5 m/s, 10 m above the start: `python -m missions.examples.figure_eight`.

The mission is built in Python. `figure_eight.yaml` is the same mission as a file.
"""

from missions.examples.fly_document import main
from missions.offboard.document import Actions, OffboardMission
from missions.offboard.positions import MissionPosition
from missions.offboard.steps import FigureEight, Land, TakeOff

HEIGHT_M = 10.0
NORTH_EAST_RAD = 0.7854

MISSION = OffboardMission(
    name="Figure-eight at 5 m/s",
    actions=Actions(low_battery="return", link_loss="hold"),
    steps=(
        TakeOff(height_m=HEIGHT_M),
        FigureEight(
            name="Two rounds",
            center=MissionPosition(offset_ned_m=(0.0, 0.0, -HEIGHT_M)),
            length_m=120.0,
            width_m=60.0,
            rounds=2,
            axis_ned_rad=NORTH_EAST_RAD,
            speed_m_s=5.0,
            heading="along_path",
        ),
        Land(),
    ),
)

if __name__ == "__main__":
    main("Fly a figure-eight twice at 5 m/s, and land.", MISSION, "figure_eight")
