"""`rarms doctor --report`: what was seen, as numbers and words of ours, and no name of anybody's."""

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import pytest

from rarms_iac.app.doctor import Connection, DoctorReport, Examinations, ExecutionPolicy, report_examinations
from rarms_iac.app.hosts import select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import ManifestSource, SnapshotSelection
from rarms_iac.app.wiring import read_script_output
from rarms_iac.model.host import ProviderKind, SchedulerType
from rarms_iac.model.seen_host import Condition, SeenHost
from rarms_iac.model.state import Partition, Rights, RunState, State, Tie
from rarms_iac.storage.codec import NotDecodable
from rarms_iac.storage.shipped import shipped_text
from tests.builders_plan import facts, partition
from tests.recorded_hosts import NAMES, document
from tests.system.test_void_hosts import ACCEPTED, Desk
from tests.unit.cli.running import rarms
from tests.unit.views.test_json import check

PLANTED = "pl4nted"
MANIFEST = f"""\
schema: rarms/v1
application: {{ name: {PLANTED}-app, description: {PLANTED} }}
policy:
  accept:
    RARMS234: {{ at: [host/{PLANTED}-host], reason: {PLANTED} }}
hosts:
  {PLANTED}-host:
    provider: hyperv
    platform: {PLANTED}-platform
    CONNECT
    logical_processors: 8
    memory: 31 GiB
    hyperv: {{ switch: {PLANTED}, image: 'D:\\{PLANTED}\\x.vhdx', vm_path: 'D:\\{PLANTED}' }}
components:
  {PLANTED}-component:
    criticality: 20
    memory: 4 GiB
    task: {PLANTED}Class
    cpu: {{ reserve: 20 % }}
partitions:
  {PLANTED}-component: {{ guest: {{ credential: {PLANTED}/secret }} }}
tasks:
  {PLANTED}Class: {{ category: Medium, priority: 6 }}
"""
SSH = f"connect: {{ ssh: '{PLANTED}-user@{PLANTED}-machine', key: /home/{PLANTED}/key }}"
WINRM = f"connect: {{ winrm: {PLANTED}.plant.example, user: '{PLANTED}', password: {{ from_env: {PLANTED} }} }}"
Way = tuple[str, ...]
VERSION = re.compile(r"[0-9]+(\.[0-9]+)+")
WORDS = {
    *(word for kinds in (ProviderKind, SchedulerType, Rights) for word in kinds),
    *(word for words in (Connection, ExecutionPolicy) for word in get_args(words)),
    *("doctor_report", "rarms-output/4", "linux", "win32", "darwin"),
}


def written(folder: Path, connect: str = SSH) -> str:
    path = folder / "rarms.yaml"
    path.write_text(MANIFEST.replace("CONNECT", connect), encoding="utf-8")
    return str(path)


def texts(value: Any) -> list[str]:
    """Every text below a JSON value, but for keys."""
    own = [value] if isinstance(value, str) else []
    return own + [holder[key] for holder, key, _ in holders(value)]


def holders(value: Any, way: Way = ()) -> Iterator[tuple[Any, Any, Way]]:
    """Where each text below a JSON value stands: what holds it, its key or number there, and the way to it."""
    if isinstance(value, list | dict):
        for key, item in list(value.items() if isinstance(value, dict) else enumerate(value)):
            inner = (*way, key if isinstance(value, dict) else "each")
            if isinstance(item, str):
                yield value, key, inner
            yield from holders(item, inner)


FREE: dict[Way, bool] = {}
"""Whether the text at the end of a way may be any, as far as it was tried."""


def planted(name: str) -> tuple[bytes, int]:
    """A recorded host with a name of ours in each text that may be any, and in how many."""
    observed, count = document(name), 0
    for holder, key, way in holders(observed):
        if key == "scope":  # a policy of another scope is not looked at
            continue
        before, holder[key] = holder[key], f"{PLANTED}-{count}"
        if way not in FREE:
            FREE[way] = is_read(observed)
        if FREE[way]:
            count += 1
        else:  # the format asks for this very text, or for one of a form
            holder[key] = before
    assert is_read(observed)
    return json.dumps(observed).encode(), count


def is_read(observed: Any) -> bool:
    try:
        return read_script_output(json.dumps(observed).encode(), PLANTED) is not None
    except NotDecodable:
        return False


@pytest.mark.parametrize("name", NAMES)
def test_report_holds_no_text_of_host_or_manifest(name: str, tmp_path: Path) -> None:
    data, count = planted(name)
    snapshot, report = tmp_path / "observed.json", tmp_path / "report.json"
    snapshot.write_bytes(data)

    ran = rarms("doctor", "-f", written(tmp_path), "--snapshot", f"{PLANTED}-host={snapshot}", "--report", str(report))

    assert ran.code in {0, 2}, ran.err
    assert count >= 100
    text = report.read_text(encoding="ascii")
    assert PLANTED not in text.lower()
    check(text)


@pytest.mark.parametrize("name", NAMES)
def test_report_consists_of_known_words_and_versions(name: str, tmp_path: Path) -> None:
    snapshot, report = tmp_path / "observed.json", tmp_path / "report.json"
    observed = document(name)
    snapshot.write_text(json.dumps(observed), encoding="utf-8")
    words = ("doctor", "-f", written(tmp_path), "--snapshot", f"{PLANTED}-host={snapshot}")

    rarms(*words, "--report", str(report))

    answer = json.loads(report.read_text(encoding="ascii"))
    check(json.dumps(answer))
    assert {text for text in texts(answer) if not VERSION.fullmatch(text)} <= WORDS
    (host,) = answer["hosts"]
    examined = json.loads(rarms(*words, "--json").out)
    (seen,) = examined["hosts"]
    assert host["powershell"] == seen["condition"]["powershell"]
    assert host["seen"]["scheduler"] == seen["facts"]["scheduler"]
    assert sorted(host["findings"]) == sorted({finding["code"] for finding in seen["findings"]})
    assert sum(host["findings"].values()) == len(seen["findings"])
    assert sum(answer["accepted"].values()) == len(examined["accepted"])
    assert host["machines"]["all"] == seen["machines"] == sum(host["states"].values())


def test_a_simulated_host_and_what_its_manifest_accepts(tmp_path: Path) -> None:
    report = tmp_path / "report.json"

    ran = Desk(tmp_path).run("doctor", "--report", str(report), host="scheduler: root", policy=ACCEPTED)

    assert ran.code == 0
    assert f"Wrote {report}" in ran.err
    answer = json.loads(report.read_text(encoding="ascii"))
    (host,) = answer["hosts"]
    assert (host["seen"]["provider"], host["connection"], host["seen"]["scheduler"]) == ("simulated", "here", "root")
    assert (host["findings"], answer["accepted"]) == ({}, {"RARMS159": 1})


@pytest.mark.needs("linux")
def test_a_linux_host(tmp_path: Path) -> None:
    desk, report = Desk(tmp_path), tmp_path / "report.json"
    desk.text = desk.text.replace("provider: simulated ", "provider: linux ")
    desk.manifest.write_text(desk.text, encoding="utf-8")

    ran = rarms("doctor", "-f", str(desk.manifest), "--report", str(report))

    assert ran.code in {0, 2}, ran.err
    text = report.read_text(encoding="ascii")
    check(text)
    (host,) = json.loads(text)["hosts"]
    assert (host["seen"]["provider"], host["connection"], host["powershell"]) == ("linux", "here", None)
    assert {word for word in texts(host) if not VERSION.fullmatch(word)} <= WORDS


def test_doctor_report_replaces_no_file(tmp_path: Path) -> None:
    desk, report, lost = Desk(tmp_path), tmp_path / "report.json", tmp_path / "lost" / "report.json"
    report.write_text("mine", encoding="utf-8")

    refused = desk.run("doctor", "--report", str(report))
    missing = desk.run("doctor", "--report", str(lost))

    assert (refused.code, "error[RARMS177]" in refused.err) == (1, True)
    assert report.read_text(encoding="utf-8") == "mine"
    assert (missing.code, lost.exists()) == (1, False)


@pytest.mark.needs("posix")
def test_nothing_is_answerthrough_a_link(tmp_path: Path) -> None:
    link, behind = tmp_path / "report.json", tmp_path / "behind.json"
    link.symlink_to(behind)

    assert Desk(tmp_path / "desk").run("doctor", "--report", str(link)).code == 1
    assert not behind.exists()


@pytest.mark.parametrize(("connect", "word"), [("", "here"), (SSH, "ssh"), (WINRM, "winrm")])
def test_report_says_connection_and_counts_machines(connect: str, word: str, tmp_path: Path) -> None:
    replica = partition(application=None)
    machines = (
        replace(replica, ties=(Tie.REPLICA,), foreign_mark=f"{PLANTED} is a replica"),
        replace(replica, ties=(Tie.CLUSTER,), state=RunState.RUNNING, can_be_asked=False),
    )

    report = _report(written(tmp_path, connect), machines)

    (host,) = report.hosts
    assert host.connection == word
    assert (host.powershell, host.module) == (None, ("2.0.0.0",))
    assert host.ties == {Tie.REPLICA: 1, Tie.CLUSTER: 1}
    assert [host.machines[name] for name in ("marked_replicas", "marks_not_believed", "mute")] == [1, 1, 1]


def _report(manifest: str, machines: tuple[Partition, ...]) -> DoctorReport:
    hosts = select_hosts(load_manifest(ManifestSource(manifest=manifest)), SnapshotSelection())
    (host,) = hosts.system.hosts.values()
    examined = SeenHost(
        host=host,
        application=PLANTED,
        state=State(facts=facts(host.name), partitions=machines),
        condition=Condition(powershell=PLANTED, module=(PLANTED, "2.0.0.0")),
    )
    return report_examinations(hosts, Examinations(application=PLANTED, hosts=(examined,), accepted=()))


def test_the_schema_that_rarms_prints_has_the_report() -> None:
    assert "DoctorReport" in json.loads(shipped_text("schemas/output.json"))["$defs"]
