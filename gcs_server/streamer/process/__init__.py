"""The process that runs the schedule, and the server's side of it."""
