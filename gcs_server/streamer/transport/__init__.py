"""The last step of a setpoint: packs it into MAVLink or ROS 2 messages and passes them to the sender."""
