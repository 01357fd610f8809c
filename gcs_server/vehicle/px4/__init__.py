"""What is PX4's: modes, arming checks, events, and its action when setpoints stop."""
