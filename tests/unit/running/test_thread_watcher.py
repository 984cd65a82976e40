"""What the watcher of threads reads, and what it reports; real threads are in `tests/system/test_thread_watcher.py`."""

import json
import os
from pathlib import Path

import pytest

from rarms_iac.running import thread_watcher
from rarms_iac.running.thread_priorities import ThreadRule, rules_of, rules_text
from rarms_iac.running.thread_watcher import ThreadWatcher

pytestmark = pytest.mark.needs("linux")


@pytest.fixture
def said(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What the watcher writes to the log."""
    monkeypatch.setattr(thread_watcher, "real_time_is_endless", lambda: False)
    return []


def write(folder: Path, rules: object, name: str = "rarms") -> None:
    file = folder / f"{name}.threads"
    file.with_suffix(".new").write_text(rules if isinstance(rules, str) else json.dumps(rules), encoding="utf-8")
    file.with_suffix(".new").replace(file)


def test_rules_are_read_as_written() -> None:
    rules = (ThreadRule("controller*", 21), ThreadRule("look at it", 5))

    assert rules_text(rules) == "controller* at 21, look at it at 5"
    assert rules_of(rules_text(rules)) == rules
    assert rules_of("") == ()
    with pytest.raises(ValueError, match="invalid literal"):
        rules_of("controller*")


def test_only_changes_are_told(tmp_path: Path, said: list[str]) -> None:
    watcher = ThreadWatcher(tmp_path, said.append)
    assert not watcher.read()

    write(tmp_path, {"/x/rarms/arm": "controller* at 21", "/x/rarms/eyes": "grab at 5"})
    assert watcher.read()
    assert watcher.read()
    write(tmp_path, {"/x/rarms/arm": "controller* at 22"})
    assert watcher.read()
    (tmp_path / "rarms.threads").unlink()

    assert not watcher.read()
    assert said == [
        "arm: priorities of threads: controller* at 21.",
        "eyes: priorities of threads: grab at 5.",
        "eyes: threads have their usual priority again.",
        "arm: priorities of threads: controller* at 22.",
        "arm: threads have their usual priority again.",
    ]


@pytest.mark.parametrize("text", ["", "[]", "{", '{"/x/arm": 3}', '{"/x/arm": "controller*"}', '{"/x/arm": null}'])
def test_unreadable_file_keeps_its_rules_and_is_told_once(tmp_path: Path, said: list[str], text: str) -> None:
    watcher = ThreadWatcher(tmp_path, said.append)
    write(tmp_path, {"/x/rarms/arm": "controller* at 21"})
    write(tmp_path, {"/x/other/eyes": "grab at 5"}, "other")
    watcher.read()
    del said[:]

    write(tmp_path, text)
    assert watcher.read()
    assert watcher.read()

    (line,) = said
    assert line.startswith(f"{tmp_path}/rarms.threads cannot be read: ")
    assert line.endswith(" The earlier rules remain valid.")


def test_endless_real_time_gives_no_priority(tmp_path: Path, said: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    watcher = ThreadWatcher(tmp_path, said.append)
    write(tmp_path, {"/x/rarms/arm": "controller* at 21"})
    watcher.read()
    del said[:]

    monkeypatch.setattr(thread_watcher, "real_time_is_endless", lambda: True)
    assert watcher.read()
    assert watcher.read()
    first, second = said
    assert "sched_rt_runtime_us does not limit real-time threads" in first
    assert second == "arm: threads have their usual priority again."

    monkeypatch.setattr(thread_watcher, "real_time_is_endless", lambda: False)
    assert watcher.read()
    assert said[2:] == ["arm: priorities of threads: controller* at 21."]


def test_name_without_a_thread_is_told_once(tmp_path: Path, said: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    group = tmp_path / "arm"
    group.mkdir()
    (group / "cgroup.procs").write_text("", encoding="ascii")
    write(tmp_path, {str(group): "no such thread at 21"})
    watcher = ThreadWatcher(tmp_path, said.append)
    watcher.read()
    del said[:]
    monkeypatch.setattr(thread_watcher, "UNMATCHED_S", -1.0)

    watcher.look()
    assert said == [], "no process runs yet"
    (group / "cgroup.procs").write_text(f"{os.getpid()}\n", encoding="ascii")
    watcher.look()
    watcher.look()

    (line,) = said
    assert line.startswith("arm: no thread has the name no such thread. Its threads: ")
