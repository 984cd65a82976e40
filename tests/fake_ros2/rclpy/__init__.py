"""A stand-in for rclpy: nodes that send datagrams between sockets in the folder that FAKE_ROS2 names.

Messages are bytes of ROS 2 (CDR), as `rosbags` writes them. It does not show discovery, DDS, or qualities of service.
"""

import json
import os
import select
import socket
import struct
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

Heard = Callable[[bytes], None]
FOLDER = Path(os.environ["FAKE_ROS2"])


def message_class(**fields: str) -> type:
    """Return a class with the methods that the subscriber needs."""
    own = {"__init__": lambda self, **values: self.__dict__.update(values)}
    return type("Message", (), {**own, "get_fields_and_field_types": staticmethod(lambda: fields)})


MESSAGES = {
    "std_msgs/msg/Header": message_class(stamp="builtin_interfaces/Time", frame_id="string"),
    "sensor_msgs/msg/Image": message_class(header="std_msgs/Header", height="uint32"),
    "builtin_interfaces/msg/Time": message_class(sec="int32", nanosec="uint32"),
    "std_msgs/msg/String": message_class(data="string"),
}


def publish(topic: str, data: bytes) -> None:
    """Send bytes to all nodes."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        for node in FOLDER.glob("*.node"):
            try:
                sender.sendto(topic.encode() + b"\0" + data, str(node))
            except OSError:
                continue  # a node that has ended


class Node:
    """A node with its subscriptions."""

    def __init__(self, name: str) -> None:
        self.heard = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.heard.bind(str(FOLDER / f"{name}.node"))
        self.subscriptions: dict[str, Heard] = {}

    def get_topic_names_and_types(self) -> list[tuple[str, list[str]]]:
        """Return what `topics.json` says."""
        return [(name, [kind]) for name, kind in json.loads((FOLDER / "topics.json").read_text()).items()]

    def count_publishers(self, topic: str) -> int:
        return sum(name == topic for name, _ in self.get_topic_names_and_types())

    def create_subscription(
        self, kind: type, topic: str, callback: Callable[[bytes], None], quality: object, *, raw: bool
    ) -> None:
        assert raw, "the callback wants bytes"
        self.subscriptions[topic.lstrip("/")] = callback

    def create_publisher(self, kind: type, topic: str, quality: object) -> SimpleNamespace:
        def send(header: Any) -> None:
            publish(topic, b"\0\1\0\0" + struct.pack("<iII", header.stamp.sec, header.stamp.nanosec, 1) + b"\0")

        return SimpleNamespace(publish=send)


def init() -> None: ...


def shutdown() -> None: ...


def ok() -> bool:
    return True


create_node = Node


def spin_once(node: Node, timeout_sec: float) -> None:
    """Hand one message that comes in time to its subscription."""
    if select.select([node.heard], [], [], timeout_sec)[0]:
        topic, _, data = node.heard.recv(1 << 20).partition(b"\0")
        if callback := node.subscriptions.get(topic.decode().lstrip("/")):
            callback(data)
