"""What if: the simulator flies a part of a logged flight again, once as it was and once with changes.

`flight.py` is what is taken from the log, `model.py` the model of the aircraft and its wind. `rerun.py` flies
with the logged setpoints, `autopilot.py` with the simulated PX4; `task.py` has plain values as input and
output. Like the dry run, it imports the simulator.
"""
