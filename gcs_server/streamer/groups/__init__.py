"""Groups: several vehicles that start together, are checked against each other and are stopped in one
call."""
