"""Real PX4s in software-in-the-loop simulation (SITL), from what is installed on this computer."""
