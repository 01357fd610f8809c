"""Links to PX4 over its ROS 2 topics, without ROS: only `dds.py` and `dds_types.py` import Cyclone DDS."""
