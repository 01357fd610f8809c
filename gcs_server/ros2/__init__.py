"""Links to PX4 over its ROS 2 topics. ROS is not needed; only the modules `dds*.py` import Cyclone DDS."""
