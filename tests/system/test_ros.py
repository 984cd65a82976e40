"""Samples of messages: with real nodes of ROS 1, and with serialized messages of ROS 2 behind a stand-in of rclpy."""

import contextlib
import json
import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from rarms_iac.model.run import Run, Samples
from rarms_iac.model.series import HeardMessages, Sample
from rarms_iac.running.component import ComponentRun
from rarms_iac.running.orders import CannotStart, StartContext
from rarms_iac.views.progress import LiveSampleReporter
from tests.needs import CHECKOUT, SYSTEM_PYTHON
from tests.unit.running.programs import a_run, responses

ros_1 = pytest.mark.needs("ros-1")
MESSAGES = Samples(source="ros", input="/camera", output="/faces")
CAMERA = """
import rospy
from std_msgs.msg import Header, String
rospy.init_node("camera")
topics = (("/camera", Header), ("/text", String), ("/blank", Header))
camera, text, blank = (rospy.Publisher(*of, queue_size=1) for of in topics)
ahead = rospy.Duration(rospy.get_param("/ahead", 0))
while not rospy.is_shutdown():
    camera.publish(Header(stamp=rospy.Time.from_sec(__import__("time").time()) + ahead))
    text.publish("no stamp")
    blank.publish(Header())
    __import__("time").sleep(0.05)
"""
DETECTOR = """
import rospy, time, sys
from std_msgs.msg import Header
rospy.init_node("detector")
faces = rospy.Publisher("/faces", Header, queue_size=1)
seen = []
def look(message):
    seen.append(message)
    if len(seen) % 4:
        time.sleep(0.02)
        faces.publish(Header(stamp=message.stamp))
        faces.publish(Header(stamp=message.stamp))
    if len(seen) == 12 and "dies" in sys.argv:
        __import__("os")._exit(3)
rospy.Subscriber("/camera", Header, look, queue_size=1, tcp_nodelay=True)
rospy.spin()
"""


def free_port() -> int:
    with socket.socket() as any_port:
        any_port.bind(("127.0.0.1", 0))
        return int(any_port.getsockname()[1])


@pytest.fixture(scope="module")
def ros(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    """A master and a camera of ROS 1; the value is the environment of other nodes."""
    folder = tmp_path_factory.mktemp("ros")
    port = free_port()
    own = {"ROS_MASTER_URI": f"http://127.0.0.1:{port}", "ROS_IP": "127.0.0.1", "ROS_HOME": str(folder)}
    environment = {**os.environ, **own}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": environment}
    with subprocess.Popen(["roscore", "-p", str(port)], **quiet) as core:  # type: ignore[call-overload]
        try:
            # A node that starts before its master waits for it.
            with subprocess.Popen([SYSTEM_PYTHON, "-c", CAMERA], **quiet) as camera:  # type: ignore[call-overload]
                yield environment
                camera.terminate()
        finally:
            core.terminate()


def detector(samples: Samples = MESSAGES, *words: str, until: int = 12) -> Run:
    run = a_run((SYSTEM_PYTHON, "-c", DETECTOR, *words), samples=samples, until=until, timeout=300)
    return replace(run, failures=1)


def heard(run: Run, folder: Path, environment: dict[str, str]) -> tuple[list[Sample], HeardMessages]:
    with ComponentRun("detector", run, StartContext(base=folder, environment=environment)) as running:
        samples = list(running)
        assert running.heard is not None
        return samples, running.heard


@ros_1
@pytest.mark.sample
def test_response_is_the_time_between_messages(ros: dict[str, str], tmp_path: Path) -> None:
    samples, messages = heard(detector(), tmp_path, ros)

    assert {sample.successful for sample in samples} == {True, False}
    assert max(response or 0.0 for response in responses(samples)) > 15
    assert messages.unmatched == 0
    assert messages.delay_ms is not None
    assert abs(messages.ahead_ms) < 1000
    assert not messages.simulated_time
    assert not list(Path(ros["ROS_HOME"]).rglob("rarms_samples*")), "a log file stays after each run"


@ros_1
@pytest.mark.parametrize("ends", [12, 10**6], ids=["ended", "killed"])
def test_subscriber_unregisters_at_the_master(ros: dict[str, str], tmp_path: Path, ends: int) -> None:
    """Otherwise the master calls it at its old port, where another node may listen by then."""
    script = "import rosgraph; print(rosgraph.Master('/test').getSystemState())"

    with ComponentRun("detector", detector(until=ends), StartContext(base=tmp_path, environment=ros)) as running:
        next(running)
        during = subprocess.check_output([SYSTEM_PYTHON, "-c", script], env=ros, text=True)
        if ends == 12:
            list(running)
    after = subprocess.check_output([SYSTEM_PYTHON, "-c", script], env=ros, text=True)

    assert "rarms_samples" in during
    assert "rarms_samples" not in after


@ros_1
def test_death_of_the_node_is_a_failed_sample(ros: dict[str, str], tmp_path: Path) -> None:
    samples, _ = heard(replace(detector(MESSAGES, "dies", until=99), failures=0), tmp_path, ros)

    assert samples[0].successful
    assert samples[-1].failure == "it ended with exit code 3"


@ros_1
def test_clock_ahead_and_simulated_time_are_seen(ros: dict[str, str], tmp_path: Path) -> None:
    def set_parameters(ahead: int, simulated: bool) -> None:
        script = f"import rospy; rospy.set_param('/ahead', {ahead}); rospy.set_param('/use_sim_time', {simulated})"
        subprocess.run([SYSTEM_PYTHON, "-c", script], check=True, env=ros)

    remapped, samples = "/camera:=/other", replace(MESSAGES, input="/other")
    words = [SYSTEM_PYTHON, "-c", CAMERA, remapped, "__name:=other"]
    try:
        set_parameters(3, simulated=True)
        with subprocess.Popen(words, env=ros, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as camera:
            _, messages = heard(detector(samples, remapped), tmp_path, ros)
            camera.terminate()
    finally:
        set_parameters(0, simulated=False)

    assert 2500 < messages.ahead_ms < 3500
    assert messages.simulated_time


@ros_1
def test_messages_without_header_are_refused(ros: dict[str, str], tmp_path: Path) -> None:
    with pytest.raises(CannotStart, match="/text have the type std_msgs/String, which has no header"):
        heard(detector(replace(MESSAGES, input="/text")), tmp_path, ros)


@ros_1
def test_missing_master_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rarms_iac.running.message_samples.MASTER_S", 1.0)
    uri = f"http://127.0.0.1:{free_port()}"
    program = tmp_path / "node.py"
    program.write_text("open('started', 'w')\n", encoding="utf-8")
    run = a_run((SYSTEM_PYTHON, str(program)), samples=MESSAGES, until=12, timeout=300)

    with pytest.raises(CannotStart, match=f"the ROS master at {uri} does not answer"):
        heard(run, tmp_path, {**os.environ, "ROS_MASTER_URI": uri})

    assert not (tmp_path / "started").exists(), "the node does not start"


@ros_1
def test_wrong_topic_is_named(ros: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rarms_iac.running.message_samples.START_S", 8.0)

    samples, _ = heard(replace(detector(replace(MESSAGES, output="/face")), failures=0), tmp_path, ros)

    assert re.fullmatch(
        "no message of /face came within 8 s, but [0-9]+ messages of /camera; /face has no publisher",
        samples[0].failure,
    )


@ros_1
def test_only_topic_with_stamp_0_is_named(ros: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rarms_iac.running.message_samples.START_S", 4.0)

    samples, _ = heard(replace(detector(replace(MESSAGES, output="/blank")), failures=0), tmp_path, ros)

    assert re.fullmatch(
        "([0-9]+) of \\1 messages of /blank have the stamp 0; "
        "copy `msg.header.stamp` of /camera into the message of /blank",
        samples[0].failure,
    )


@ros_1
@pytest.mark.parametrize(
    ("changed", "missing"),
    [
        ({"output": "/face"}, "/face has no publisher"),
        ({"input": "/other", "output": "/face"}, "/other and /face have no publisher"),
        ({"output": "/camera_2"}, "no message of /camera_2 has the stamp of a message of /camera of the last 300 ms"),
        (
            {"output": "/blank"},
            "the messages of /blank have the stamp 0; copy `msg.header.stamp` of /camera into the message of /blank",
        ),
        (
            {"input": "/blank"},
            "the messages of /blank have the stamp 0; the publisher of /blank must set `header.stamp`",
        ),
    ],
    ids=["output", "both", "stamp", "output-0", "input-0"],
)
def test_run_says_within_seconds_what_it_waits_for(
    ros: dict[str, str], tmp_path: Path, changed: dict[str, str], missing: str
) -> None:
    said: list[tuple[float, str]] = []
    run, began = detector(replace(MESSAGES, **changed)), time.monotonic()  # type: ignore[arg-type]
    words = [SYSTEM_PYTHON, "-c", CAMERA, "/camera:=/camera_2", "__name:=second"]
    with (
        subprocess.Popen(words, env=ros, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as second,
        ComponentRun("detector", run, StartContext(base=tmp_path, environment=ros)) as running,
    ):

        def hear(text: str) -> None:
            said.append((time.monotonic() - began, text))
            running.interrupt()

        running.call_while_waiting(hear)
        assert list(running) == []
        second.terminate()

    ((after, text),) = said
    assert text == missing
    assert after < 15


def test_terminal_says_what_a_component_waits_for(capsys: pytest.CaptureFixture[str]) -> None:
    screen = SimpleNamespace(tell=print)

    LiveSampleReporter(screen).waits("detector", "/face has no publisher")

    assert capsys.readouterr().out == "detector has no sample yet: /face has no publisher.\n"


def test_no_ros_is_a_reason_not_to_start(tmp_path: Path) -> None:
    with pytest.raises(CannotStart, match="need rospy, which is not installed for any python3"):
        heard(detector(), tmp_path, {"PATH": str(tmp_path), "ROS_VERSION": "1", "PYTHONHOME": str(tmp_path)})


@pytest.fixture
def ros_2() -> Iterator[dict[str, str]]:
    """Images of ROS 2 every 20 ms, each answered after 5 ms; the value is the environment of nodes."""
    folder = Path(tempfile.mkdtemp())  # the path of a socket is short
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    made = {name: store.types[name] for name in ("builtin_interfaces/msg/Time", "std_msgs/msg/Header")}
    topics = {"/camera": "sensor_msgs/msg/Image", "/faces": "std_msgs/msg/Header"}
    (folder / "topics.json").write_text(json.dumps(topics), encoding="utf-8")
    over = threading.Event()

    def send(topic: str, data: bytes) -> None:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            for node in folder.glob("*.node"):
                with contextlib.suppress(OSError):  # a node that has ended
                    sender.sendto(topic.encode() + b"\0" + data, str(node))

    def publish() -> None:
        import numpy as np

        while not over.wait(0.02):
            seconds, nanoseconds = divmod(time.time_ns(), 10**9)
            stamp = made["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
            header = made["std_msgs/msg/Header"](stamp=stamp, frame_id="camera")
            image = store.types["sensor_msgs/msg/Image"](
                header=header, height=1, width=2, encoding="mono8", is_bigendian=0, step=2,
                data=np.zeros(2, dtype=np.uint8),
            )  # fmt: skip
            send("/camera", bytes(store.serialize_cdr(image, "sensor_msgs/msg/Image")))
            time.sleep(0.005)
            send("/faces", bytes(store.serialize_cdr(header, "std_msgs/msg/Header", little_endian=nanoseconds % 2 > 0)))

    thread = threading.Thread(target=publish)
    thread.start()
    fake = str(CHECKOUT / "tests" / "fake_ros2")
    yield {**os.environ, "PYTHONPATH": fake, "FAKE_ROS2": str(folder), "ROS_VERSION": "2"}
    over.set()
    thread.join()
    shutil.rmtree(folder)


@pytest.mark.needs("posix", "rosbags")
@pytest.mark.sample
def test_stamps_of_ros_2_are_read_from_bytes(ros_2: dict[str, str], tmp_path: Path) -> None:
    run = a_run((sys.executable, "-c", "import time; time.sleep(99)"), samples=MESSAGES, until=8, timeout=9000)

    samples, messages = heard(run, tmp_path, ros_2)

    assert max(response or 0.0 for response in responses(samples)) > 4
    assert (messages.unmatched, messages.simulated_time) == (0, False)
    assert messages.delay_ms is not None


@pytest.mark.needs("posix", "rosbags")
def test_simulated_clock_of_ros_2_is_seen(ros_2: dict[str, str], tmp_path: Path) -> None:
    topics = Path(ros_2["FAKE_ROS2"], "topics.json")
    known = json.loads(topics.read_text(encoding="utf-8"))
    topics.write_text(json.dumps({**known, "/clock": "rosgraph_msgs/msg/Clock"}), encoding="utf-8")
    run = a_run((sys.executable, "-c", "import time; time.sleep(99)"), samples=MESSAGES, until=3, timeout=300)

    assert heard(run, tmp_path, ros_2)[1].simulated_time


@pytest.mark.needs("posix", "rosbags")
def test_ros_2_type_without_header_is_refused(ros_2: dict[str, str], tmp_path: Path) -> None:
    topics = {"/camera": "std_msgs/msg/String", "/faces": "std_msgs/msg/Header"}
    Path(ros_2["FAKE_ROS2"], "topics.json").write_text(json.dumps(topics), encoding="utf-8")
    run = a_run((sys.executable, "-c", "import time; time.sleep(99)"), samples=MESSAGES, until=3, timeout=300)

    with pytest.raises(CannotStart, match="std_msgs/msg/String, which has no header"):
        heard(run, tmp_path, ros_2)


@pytest.mark.needs("posix", "rosbags")
def test_ros_2_topic_without_publisher_is_named(ros_2: dict[str, str], tmp_path: Path) -> None:
    said: list[str] = []
    words = (sys.executable, "-c", "import time; time.sleep(99)")
    run = a_run(words, samples=replace(MESSAGES, output="/face"), until=3, timeout=300)

    with ComponentRun("detector", run, StartContext(base=tmp_path, environment=ros_2)) as running:

        def hear(text: str) -> None:
            said.append(text)
            running.interrupt()

        running.call_while_waiting(hear)
        assert list(running) == []

    assert said == ["/face has no publisher"]
