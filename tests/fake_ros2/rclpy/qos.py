"""Qualities of service, which the stand-in for ROS 2 does not have."""

from types import SimpleNamespace

QoSProfile, QoSReliabilityPolicy = SimpleNamespace, SimpleNamespace(BEST_EFFORT=2)
