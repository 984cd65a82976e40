"""The commands of README.md and docs: each is run where its page has it, and each option is one that there is.

In a block of `console` a line that begins with `$` is for any system and is run here, the page's others before it; it
ends with 0, or as its remark says. A line with `PS>` is typed into the stand-in for a host's PowerShell, one with
`[NAME]: PS>` into a guest's.
"""

import os
import re
import shlex
from collections.abc import Callable, Iterator, Mapping
from contextlib import chdir
from pathlib import Path

import click
import pytest

from rarms_iac.cli.group import COMMANDS, root_group
from tests.fake_powershell import program as powershell
from tests.fake_powershell.host import Program
from tests.fake_powershell.observing import host_from
from tests.fake_powershell.server import a_bare_server, typed
from tests.files import copy_files
from tests.needs import CHECKOUT
from tests.recorded_hosts import document
from tests.remote import pwsh
from tests.robots import applied_delivery_robot
from tests.unit.cli.running import rarms

__all__ = ["pwsh"]

DOCS = CHECKOUT / "docs"
PAGES = [CHECKOUT / "README.md", *sorted(DOCS.glob("*.md"))]
FINDING_PAGES = sorted((DOCS / "findings").glob("*.md"))
BLOCK = re.compile(r"^ *```console\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)
YAML = re.compile(r"^```yaml\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SHOWN = re.compile(
    r"^ *(?P<prompt>\$|(?:\[(?P<guest>[\w-]+)\]: )?PS>) (?P<typed>.*?)(?:\s+# (?:exits (?P<code>\d+))?.*)?$",
    re.MULTILINE,
)
COMMAND = re.compile(r"^ *\$ (.*?)(?:\s+# (?:exits (\d+))?.*)?$", re.MULTILINE)
RECOMMENDED = re.compile(r"`(rarms [a-z][^`]*)`")

ELSEWHERE = {
    "ansible-playbook": "tests/system/test_ansible_collection.py",
    "ansible-pull": "tests/system/test_ansible_collection.py",
    "make": "tests/system/test_make.py",
    "pipx": "tests/system/test_wheel.py",
    "Get-ChildItem .rarms\\signed": "tests/system/test_remote_host.py",
    "Get-ChildItem module\\Rarms": "tests/system/test_remote_host.py",
    "Copy-Item module\\Rarms": "tests/system/test_remote_host.py",
}
"""Programs, and commands of PowerShell, and the tests that run what they stand for."""

CELL = """\
schema: rarms/v1
application: { name: cell }
hosts:
  cell: { logical_processors: 2, memory: 4 GiB, keep_for_host: { processor: 5 %, memory: 1 GiB } }
components:
  vision: { criticality: 30, memory: 512 MiB, cpu: { reserve: 20 % } }
"""
ON_HYPERV = CELL.replace("cell: { logical", "cell: { provider: hyperv, logical")


def in_an_empty_folder() -> None:
    """The page begins with nothing."""


def with_a_measured_robot() -> None:
    applied_delivery_robot(Path())
    assert rarms("select", "face-detection", "--at", "120 ms").code == 0


def with_a_cell() -> None:
    for folder in ("", "cell", "../base"):
        Path(folder).mkdir(exist_ok=True)
        Path(folder, "rarms.yaml").write_text(CELL, encoding="utf-8", newline="\n")


def on_a_bare_server() -> None:
    """The page's own manifest with one load and a short rehearsal, and a server whose guests will have its program.

    The page itself has three loads and ten minutes of the simulated host for a setting: four minutes here.
    """
    copy_files(CHECKOUT / "manifests" / "hyperv-cell", Path("manifests", "hyperv-cell"))
    manifest, _, rehearsal = YAML.findall((DOCS / "hyperv.md").read_text(encoding="utf-8"))
    assert "policy:" not in manifest + rehearsal
    one_load = f"{manifest}policy: {{ interference: busy-loop }}\n"
    Path("rarms.yaml").write_text(one_load, encoding="utf-8", newline="\n")
    short = f"{rehearsal}policy: {{ measuring: {{ setting: 1 min, proof: 1 min }} }}\n"
    Path("rehearse.yaml").write_text(short, encoding="utf-8", newline="\n")
    server = a_bare_server(Path("manifests", "hyperv-cell", "host.json"), "D:\\images\\windows-iot.vhdx")
    server.programs = {"track.exe": Program(work_ms=20), "powershell.exe": Program(work_ms=500, line="calibrated")}
    powershell.save(Path(), server)


def with_a_hyperv_host() -> None:
    Path("rarms.yaml").write_text(ON_HYPERV, encoding="utf-8", newline="\n")
    powershell.save(Path(), host_from(document("empty-host")))


PREPARED: Mapping[str, Callable[[], None]] = {
    "README.md": with_a_measured_robot,
    "hyperv.md": on_a_bare_server,
    "library.md": with_a_measured_robot,
    "pull-requests.md": with_a_cell,
    "scripts.md": with_a_hyperv_host,
    "tutorial.md": in_an_empty_folder,
}
"""What lies there before a page's first command."""


def blocks(page: Path) -> str:
    return "\n".join(BLOCK.findall(page.read_text(encoding="utf-8")))


def commands_of(page: Path) -> list[tuple[str, int]]:
    """The commands of a page that are for any system, and how each ends."""
    return [(command, int(code or 0)) for command, code in COMMAND.findall(blocks(page))]


def test_every_page_with_commands_is_run() -> None:
    with_commands = {page.name for page in PAGES if any(word.startswith("rarms ") for word, _ in commands_of(page))}
    commands = [command for page in PAGES for command, _ in commands_of(page)]
    at_windows = [found["typed"] for page in PAGES for found in SHOWN.finditer(blocks(page))]

    assert with_commands == set(PREPARED)
    programs = {"rarms", "cd", "mkdir", "make", "pipx", "ansible-playbook", "ansible-pull", "rostopic", "sudo"}
    assert {shlex.split(command)[0] for command in commands} == programs
    assert all(any(command.startswith(start) for command in at_windows) for start in ELSEWHERE)
    assert all((CHECKOUT / test).is_file() for test in ELSEWHERE.values())


@pytest.mark.needs("posix")
@pytest.mark.usefixtures("pwsh")
@pytest.mark.parametrize("name", PREPARED)
def test_each_command_of_page_ends_as_it_says(tmp_path: Path, name: str) -> None:
    (page,) = (page for page in PAGES if page.name == name)
    shown = [found for found in SHOWN.finditer(blocks(page)) if not found["typed"].startswith(tuple(ELSEWHERE))]
    expected = [(found["typed"], int(found["code"] or 0)) for found in shown]
    ended: list[tuple[str, int]] = []
    folder = tmp_path / "work"
    folder.mkdir()

    with chdir(folder):
        PREPARED[name]()
        for found in shown:
            at_powershell = found["prompt"] != "$"
            code = typed(found["typed"], found["guest"] or "") if at_powershell else run_here(found["typed"])
            ended.append((found["typed"], code))

    assert ended
    assert ended == expected


def run_here(command: str) -> int:
    program, *words = shlex.split(command)
    match program:
        case "cd":
            os.chdir(words[0])
        case "mkdir":
            Path(words[-1]).mkdir(parents=True)
        case _:
            assert program == "rarms"
            if words[0] == "prove":  # pages are typed at a terminal, which there is none of here
                words.append("--load-host")
            return rarms(*words).code
    return 0


def shown_commands() -> Iterator[tuple[str, str]]:
    """Every command of a page, also within a sentence, but for those with a gap."""
    for page in (*PAGES, *FINDING_PAGES):
        text = page.read_text(encoding="utf-8")
        shown = [command for command, _ in COMMAND.findall("\n".join(BLOCK.findall(text)))]
        for command in [*shown, *(" ".join(found.split()) for found in RECOMMENDED.findall(text))]:
            if command.startswith("rarms ") and "..." not in command:
                yield page.name, command


def unknown_option(command: str) -> str:
    """What the command line does not know of a command; empty where it knows all."""
    words = shlex.split(re.split(r" [<>|] ", command)[0])[1:]
    group = root_group()
    context = click.Context(group, info_name="rarms")
    known = group.get_command(context, words[0])
    if known is None:
        return "" if words[0].startswith("-") else f"no command {words[0]}"
    try:
        known.make_parser(click.Context(known, info_name=words[0], parent=context)).parse_args(words[1:])
    except click.BadOptionUsage:
        return ""  # a sentence names the option alone, without its value
    except click.UsageError as error:
        return error.format_message()
    return ""


def test_options_on_pages_exist() -> None:
    shown = list(shown_commands())

    assert len(shown) > 200
    assert {shlex.split(command)[1] for _, command in shown} <= {*COMMANDS, "--help", "--version"}
    assert [(page, command, unknown) for page, command in shown if (unknown := unknown_option(command))] == []


def test_every_picture_of_a_page_is_there() -> None:
    pictures = [
        (page, picture)
        for page in PAGES
        for picture in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", page.read_text(encoding="utf-8"))
    ]

    assert pictures
    assert [(page.name, picture) for page, picture in pictures if not (page.parent / picture).is_file()] == []
