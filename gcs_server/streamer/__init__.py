"""The offboard setpoint streams, in rooms; the order of the rooms is an import contract.

A setpoint goes: `missions/setpoints.py` (kinds) → `validation` → `frames` → `limits` → `schedule` →
`transport`. `values` is what the rooms hand to each other, `separation` keeps the vehicles of a group apart,
`groups` starts and stops them together, `process` runs the schedule in a process of its own, `offboard` is a
vehicle's side in the event loop.
"""
