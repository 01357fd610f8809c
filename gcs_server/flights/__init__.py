"""What flies a plan, between the routes and the stream engine: choosing the plan, checking it, comparing it
with other flights, dry runs, starting, watching and resuming it; groups of vehicles."""
