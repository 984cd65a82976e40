"""Message classes of the stand-in for ROS 2."""

from rclpy import MESSAGES  # type: ignore[import-not-found, unused-ignore]

get_message = MESSAGES.__getitem__
