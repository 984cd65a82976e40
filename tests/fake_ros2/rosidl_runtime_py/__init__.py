"""A part of the stand-in for ROS 2."""
