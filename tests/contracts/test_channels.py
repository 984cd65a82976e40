"""What each way to a host that runs one command keeps: here behind a shell, a real sshd, and Ansible's connection."""

import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from rarms_iac.model.host import Connect
from rarms_iac.providers.channel import SSH_FAILED, CommandChannel, ssh_channel
from rarms_iac.providers.interface import HostUnreachable
from tests.contracts.benches import shell_channel
from tests.needs import CHECKOUT, require
from tests.remote import a_server

pytestmark = [pytest.mark.needs("posix")]

SILENCE_S = 60.0


@contextmanager
def a_shell(folder: Path) -> Iterator[CommandChannel]:
    yield shell_channel()


@contextmanager
def by_ssh(folder: Path) -> Iterator[CommandChannel]:
    require("ssh")
    with a_server(folder) as remote, pytest.MonkeyPatch.context() as patch:
        patch.setenv("PATH", remote.environment["PATH"])
        yield ssh_channel("onboard", Connect(ssh="cell"))


@contextmanager
def by_ansible(folder: Path) -> Iterator[CommandChannel]:
    """Ansible's own plugin for this machine, below what an action calls."""
    yield ansible_channel("local")


@cache
def ansible_channel(plugin: str) -> CommandChannel:
    """The collection's channel over a plugin of Ansible, whose loader of collections is set up once a process."""
    require("ansible")
    from ansible.playbook.play_context import PlayContext
    from ansible.plugins.loader import connection_loader, init_plugin_loader
    from ansible.utils.collection_loader import AnsibleCollectionConfig

    if AnsibleCollectionConfig.collection_finder is None:
        init_plugin_loader([str(CHECKOUT / "ansible")])
    robot = import_module("ansible_collections.rarms.fleet.plugins.plugin_utils.robot")
    play = PlayContext()
    play.remote_addr, play.remote_user = "127.0.0.1", "ann"
    connection = connection_loader.get(plugin, play, os.devnull)
    connection.set_options(direct={"host": "127.0.0.1", "port": 1, "ssh_args": "-o BatchMode=yes"})

    def execute(command: str, in_data: bytes) -> dict[str, Any]:
        code, out, error = connection.exec_command(command, in_data=in_data, sudoable=False)
        return {"rc": code, "stdout": out.decode(), "stderr": error.decode()}

    action = SimpleNamespace(_play_context=play, _low_level_execute_command=execute)
    channel: CommandChannel = robot.ConnectionChannel(action, "onboard")
    return channel


CHANNELS: dict[str, Callable[[Path], Any]] = {"shell": a_shell, "ssh": by_ssh, "ansible": by_ansible}


@pytest.fixture(params=CHANNELS)
def channel(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[CommandChannel]:
    with CHANNELS[request.param](tmp_path) as opened:
        yield opened


def test_whole_input_arrives_and_ends(channel: CommandChannel) -> None:
    data = bytes(range(256)) * 2_000 + b"without an end"

    answer = channel.run("sha256sum", data, SILENCE_S)

    assert (answer.code, answer.output.split()[0]) == (0, hashlib.sha256(data).hexdigest())


def test_command_without_input_does_not_wait_for_any(channel: CommandChannel) -> None:
    assert channel.run("cat; echo ended", b"", SILENCE_S).output.strip() == "ended"


def test_exit_code_output_and_error_come_back_apart(channel: CommandChannel) -> None:
    answer = channel.run("printf 'one\\ntwo\\n'; echo wrong >&2; exit 3", b"", SILENCE_S)

    assert (answer.code, answer.output, answer.error.strip()) == (3, "one\ntwo\n", "wrong")


def test_nothing_of_command_is_left_for_next(channel: CommandChannel) -> None:
    channel.run("cd /; PLANT=9; export PLANT", b"", SILENCE_S)

    answer = channel.run('echo "${PLANT-none}"; [ "$PWD" = / ] && echo changed', b"", SILENCE_S)

    assert answer.output.split() == ["none"]


def test_unreachable_host_is_told_and_ran_nothing() -> None:
    require("ssh")
    by_itself = ssh_channel("onboard", Connect(ssh="ann@127.0.0.1", port=1))
    assert by_itself.run("true", b"", SILENCE_S).code == SSH_FAILED

    with pytest.raises(HostUnreachable, match=r"ann@127\.0\.0\.1 cannot be reached"):
        ansible_channel("ssh").run("true", b"", SILENCE_S)
