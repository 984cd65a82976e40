"""Subscribes to two topics of ROS and sends when each message came, with its stamp. A program of its own.

Arguments: 1 or 2 (the version of ROS), the input topic and the output topic. It runs next to the component's partition,
with the Python that has rospy or rclpy (3.8 or newer). Messages are not decoded: their header comes first in their
bytes, so their Python classes need not be installed for ROS 1.

Standard output has a JSON object a line, of one write:

- `{"topic": "input", "stamp": 1700000000500000000, "at": 12.5, "ahead_ms": -0.4}`: a message. `stamp` is in ns, `at` is
  `time.perf_counter`, which all processes of Linux share, and `ahead_ms` is the stamp less this machine's clock.
- `{"delay_ms": 0.3}`: how long a message that it publishes to itself takes. `{"simulated": true}`: `use_sim_time`.
- `{"no_master": "http://..."}`: ROS 1 has no master there yet.
- `{"unpublished": ["/faces"]}`: the topics without a publisher, each second until both topics had a message.
- `{"cannot": "..."}`: why no message can be used; it then ends.

It ends on SIGTERM, and when nobody reads its output. It then unregisters at the master of ROS 1, which would otherwise
call it at its old port for ever, where another node may listen by then.
"""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import struct
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

PROBE_S = 0.1
"""How often it measures its own delay."""
WAIT_S = 0.2
LOOK_S = 1.0
"""How often it looks for publishers, until both topics had a message: a measurement is not disturbed by it."""
HEADERS = ("Header", "std_msgs/Header", "std_msgs/msg/Header")
QUEUE = 1000
ENDED: list[str] = []
"""Why it is to end. No lock: a signal handler may run while one is held."""
HEARD: set[str] = set()
"""The roles of the topics that had a message."""
_FIELD = re.compile(r"^\s*([\w/\[\]<>=]+)\s+\w+\s*(#.*)?$")


@contextmanager
def no_log_file() -> Iterator[None]:
    """Have the log file that ROS opens inside removed at once: each run would leave one in the user's `~/.ros/log`."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ["ROS_LOG_DIR"] = folder
        yield


def main(words: list[str]) -> None:
    """Subscribe, and send what comes until the reader has gone."""
    version, source, target = words
    signal.signal(signal.SIGTERM, lambda *_: ENDED.append("SIGTERM"))
    (subscribe_1 if version == "1" else subscribe_2)({"input": source, "output": target})


def send(**values: object) -> None:
    """Send a JSON object in one write, which a pipe does not tear; end where nobody reads it."""
    try:
        os.write(1, json.dumps(values).encode() + b"\n")
    except BrokenPipeError:
        ENDED.append("nobody reads")


def give_up(reason: str) -> None:
    """Send why no message can be used, and end."""
    send(cannot=reason)
    ENDED.append(reason)


def send_message(role: str, stamp: int, at: float) -> None:
    """Send that a message came; the role `delay` is that of this program's own ones."""
    HEARD.add(role)
    ahead_ms = (stamp - time.time_ns()) / 1e6 + 1000 * (time.perf_counter() - at)
    if role == "delay":
        send(delay_ms=max(0.0, -ahead_ms))
    else:
        send(topic=role, stamp=stamp, at=at, ahead_ms=ahead_ms)


def look_for_publishers(topics: dict[str, str], next_look: float, published: Callable[[], set[str]]) -> float:
    """Send which topics have no publisher, if it is time and one had no message yet; return when it is time again.

    `published` returns the topics with a publisher; OSError: the master does not answer now.
    """
    if time.perf_counter() < next_look or set(topics) <= HEARD:
        return next_look
    try:
        there = published()
    except OSError:
        return time.perf_counter() + LOOK_S
    send(unpublished=[topic for role, topic in topics.items() if role not in HEARD and topic not in there])
    return time.perf_counter() + LOOK_S


def first_field(definition: str) -> str:
    """Return the type of the first field in the definition of a ROS 1 message; constants are no fields."""
    for line in definition.splitlines():
        found = _FIELD.match(line)
        if found:
            return found.group(1)
    return ""


def subscribe_1(topics: dict[str, str]) -> None:
    """Subscribe with rospy."""
    import rospy  # type: ignore[import-not-found,unused-ignore]
    from std_msgs.msg import Header  # type: ignore[import-not-found,unused-ignore]

    socket.setdefaulttimeout(5.0)
    while not ENDED:
        try:
            rospy.get_master().getPid()
            break
        except (OSError, rospy.ROSException):
            send(no_master=os.environ.get("ROS_MASTER_URI", "http://localhost:11311"))
            time.sleep(WAIT_S)
    else:
        return
    socket.setdefaulttimeout(None)
    with no_log_file():
        rospy.init_node("rarms_samples", anonymous=True, disable_signals=True)
    send(simulated=bool(rospy.get_param("/use_sim_time", False)))

    def listen(role: str, topic: str) -> None:
        known: dict[str, bool] = {}  # whether it begins with a header, by type

        def take(message: Any) -> None:
            at = time.perf_counter()
            kind = message._connection_header["type"]  # noqa: SLF001 - rospy offers it nowhere else
            if kind not in known:
                definition = message._connection_header.get("message_definition", "")  # noqa: SLF001
                known[kind] = kind in HEADERS or first_field(definition) in HEADERS
            if not known[kind]:
                give_up(without_header(topic, kind))
                return
            _, seconds, nanoseconds = struct.unpack_from("<III", message._buff)  # noqa: SLF001
            send_message(role, seconds * 10**9 + nanoseconds, at)

        rospy.Subscriber(topic, rospy.AnyMsg, take, queue_size=QUEUE, tcp_nodelay=True)

    probe = rospy.Publisher(rospy.get_name() + "/delay", Header, queue_size=1, tcp_nodelay=True)
    for role, topic in {**topics, "delay": rospy.get_name() + "/delay"}.items():
        listen(role, topic)

    def published() -> set[str]:
        names = {entry for entry, nodes in rospy.get_master().getSystemState()[2][0] if nodes}
        return {topic for topic in topics.values() if rospy.resolve_name(topic) in names}

    next_look = 0.0
    while not ENDED:
        time.sleep(PROBE_S)
        next_look = look_for_publishers(topics, next_look, published)
        now = time.time_ns()
        probe.publish(Header(stamp=rospy.Time(now // 10**9, now % 10**9)))
    leave_master(rospy.get_master(), rospy.get_name(), rospy.get_node_uri())
    os._exit(0)  # rospy's own end joins threads, which takes seconds and a processor


def leave_master(master: Any, name: str, uri: str) -> None:
    """Unregister all that this node has at the master of ROS 1; a master that does not answer has nothing to forget."""
    socket.setdefaulttimeout(1.0)
    try:
        publishers, subscribers, services = master.getSystemState()[2]
        for topic in of_node(publishers, name):
            master.unregisterPublisher(topic, uri)
        for topic in of_node(subscribers, name):
            master.unregisterSubscriber(topic, uri)
        for service in of_node(services, name):
            master.unregisterService(service, master.lookupService(service)[2])
    except OSError:
        return


def of_node(entries: list[Any], name: str) -> list[str]:
    """Return the names of the entries that a node has."""
    return [entry for entry, nodes in entries if name in nodes]


def without_header(topic: str, kind: str) -> str:
    """Say that the messages of a topic have no stamp."""
    return f"messages of {topic} have the type {kind}, which has no header at its beginning"


def cdr_stamp(data: bytes) -> int:
    """Return the stamp of a serialized ROS 2 message that begins with a header, in ns."""
    seconds, nanoseconds = struct.unpack_from("<iI" if data[1] & 1 else ">iI", data, 4)
    return int(seconds) * 10**9 + int(nanoseconds)


def subscribe_2(topics: dict[str, str]) -> None:
    """Subscribe with rclpy."""
    import rclpy  # type: ignore[import-not-found,unused-ignore]
    from rclpy.qos import QoSProfile, QoSReliabilityPolicy  # type: ignore[import-not-found,unused-ignore]
    from rosidl_runtime_py.utilities import get_message  # type: ignore[import-not-found,unused-ignore]

    with no_log_file():
        rclpy.init()
    name = f"rarms_samples_{os.getpid()}"
    node = rclpy.create_node(name)
    # Best effort takes messages of reliable publishers, too; the contrary would hear nothing of a camera.
    quality = QoSProfile(depth=QUEUE, reliability=QoSReliabilityPolicy.BEST_EFFORT)

    def listen(role: str, topic: str, kind: str) -> None:
        message_class = get_message(kind)
        fields = list(message_class.get_fields_and_field_types().values())
        if kind not in HEADERS and fields[:1] not in ([header.replace("/msg", "")] for header in HEADERS):
            give_up(without_header(topic, kind))
            return

        def take(data: bytes) -> None:
            at = time.perf_counter()
            send_message(role, cdr_stamp(data), at)

        node.create_subscription(message_class, topic, take, quality, raw=True)

    header_class, time_class = get_message("std_msgs/msg/Header"), get_message("builtin_interfaces/msg/Time")
    probe = node.create_publisher(header_class, name + "/delay", quality)
    listen("delay", name + "/delay", "std_msgs/msg/Header")
    unknown = dict(topics)
    next_probe = next_search = next_look = 0.0

    def published() -> set[str]:
        return {topic for topic in topics.values() if node.count_publishers(topic)}

    while rclpy.ok() and not ENDED:
        now = time.perf_counter()
        if unknown and now >= next_search:
            next_search = now + WAIT_S
            kinds = dict(node.get_topic_names_and_types())
            for role, topic in list(unknown.items()):
                if topic in kinds:
                    listen(role, topic, kinds[topic][0])
                    del unknown[role]
            if not unknown:
                send(simulated=node.count_publishers("/clock") > 0)
        next_look = look_for_publishers(topics, next_look, published)
        if now >= next_probe:
            next_probe = now + PROBE_S
            seconds, nanoseconds = divmod(time.time_ns(), 10**9)
            probe.publish(header_class(stamp=time_class(sec=seconds, nanosec=nanoseconds)))
        rclpy.spin_once(node, timeout_sec=max(0.0, next_probe - time.perf_counter()))
    rclpy.shutdown()


if __name__ == "__main__":
    main(sys.argv[1:])
