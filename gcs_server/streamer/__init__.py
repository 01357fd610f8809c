"""The offboard setpoint streams. The order of the packages is an import contract. A setpoint passes through:
`missions/setpoints.py` (kinds) → `validation` → `frames` → `limits` → `schedule` → `transport`. `values`
contains the types that the packages exchange. `separation` keeps the vehicles of a group apart, and `groups`
starts and stops them together. `process` runs the schedule in a separate process. `offboard` is the event
loop's interface to each vehicle's stream.
"""
