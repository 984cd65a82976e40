"""What the page sends and is answered: work, its command and its end; levels that are shown and written; refusals."""

import json
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from http.client import HTTPConnection
from pathlib import Path

import pytest

from rarms_iac.storage import disk
from rarms_iac.storage.writing import hold
from rarms_iac.studio.actions import ACTIONS, MeasureAction, ProveAction, TuneAction
from tests.crashing import Crash, CrashingDisk
from tests.measuring import leave_curves
from tests.needs import CHECKOUT
from tests.unit.cli.running import rarms
from tests.unit.studio.studio_client import TIGHT, Client, studio

MANIFEST = (CHECKOUT / "templates/init/rarms.yaml").read_text(encoding="utf-8")
RUN = "run: { command: [control], until: { samples: 2000 }, samples: { from: per_run } }"
LEVEL = {"component": "control", "index": "mean_response_time", "level": "45 ms"}
LEVELS = {"levels": [LEVEL]}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "rarms.yaml").write_text(MANIFEST, encoding="utf-8", newline="\n")
    return tmp_path


@pytest.fixture
def client(folder: Path) -> Iterator[Client]:
    with studio(folder) as entered:
        entered.enter()
        yield entered


def text(folder: Path) -> str:
    return (folder / "rarms.yaml").read_text(encoding="utf-8")


def done(client: Client, action: str, **body: object) -> dict[str, object]:
    answer = client.post(f"do/{action}", body)
    assert answer.status == 200, answer.text
    return client.work("*")


def test_each_action_shows_command_that_does_same() -> None:
    measured = MeasureAction(components=["control"], first=10, last=40, step=10, weak_load=True, stop_partitions=True)
    words = "rarms measure control --from 10% --to 40% --step 10% --stop-partitions --weak-load"

    assert measured.command().text == words
    assert TuneAction(dry_run=True, on_busy_host=True).command().text == "rarms tune --dry-run --on-busy-host"
    assert ProveAction(without_load=True).command().text == "rarms prove --without-load"
    assert [name for name, kind in ACTIONS.items() if not kind.changes] == ["plan", "plan-start", "undo-preview"]


def test_plan_is_applied_once_after_name_was_typed(client: Client) -> None:
    name = client.get().text.split("<h1>")[1].split("</h1>")[0]
    assert done(client, "plan")["ending"] == "done"
    page = client.get().text
    plan = page.split('data-body=\'{"plan": "')[1].split('"')[0]

    wrong = done(client, "apply", plan=plan, application="another")
    other = done(client, "apply", plan="0123456789ab", application=name)
    applied = done(client, "apply", plan=plan, application=name)
    again = done(client, "apply", plan=plan, application=name)

    assert [each["ending"] for each in (wrong, other, applied, again)] == ["failed", "failed", "done", "failed"]
    assert "is not the application" in str(wrong["lines"])
    rows = applied["rows"]
    assert isinstance(rows, list)
    assert [row[1] for row in rows] == [f"{number} of {len(rows)}" for number in range(1, len(rows) + 1)]
    assert {row[4] for row in rows} <= {"changed", "unchanged"}
    assert "2 added" in str(applied["lines"])
    shown = done(client, "undo-preview")
    assert shown["ending"] == "shown"
    assert 'data-action="undo"' in client.get().text
    assert done(client, "undo", application=name)["ending"] == "done"
    assert 'data-action="undo"' not in client.get().text, "there is nothing left to undo"


def test_undo_after_measuring_is_the_users(client: Client, folder: Path) -> None:
    assert rarms("apply", "--auto-approve", "-f", str(folder)).code == 0
    assert 'data-action="undo"' in client.get().text

    assert done(client, "measure", components=["control"], first=50, last=50, stop_partitions=True)["ending"] == "done"

    page = client.get().text
    assert 'data-action="undo"' in page
    assert "remove" in str(done(client, "undo-preview")["lines"])


def test_proof_asks_for_idle_time_of_hosts(client: Client) -> None:
    refused = done(client, "prove")

    assert refused["ending"] == "failed"
    assert "loads the hosts fully" in str(refused["lines"])


def test_level_is_previewed_and_written(client: Client, folder: Path) -> None:
    shown = client.post("levels", LEVELS).data
    assert "-      mean_response_time: { at_most: 50 ms }" in str(shown["difference"])
    assert text(folder) == MANIFEST, "a preview writes nothing"

    (folder / "rarms.yaml").write_text(MANIFEST + "# another hand\n", encoding="utf-8", newline="\n")
    late = client.post("levels", {**LEVELS, "digest": shown["digest"]})
    assert (late.status, "has changed since" in late.text) == (409, True)
    again = client.post("levels", LEVELS).data
    written = client.post("levels", {**LEVELS, "digest": again["digest"]})

    assert written.status == 200
    assert text(folder) == MANIFEST.replace("at_most: 50 ms", "at_most: 45 ms") + "# another hand\n"
    assert client.post("levels", LEVELS).data["difference"] == ""


def test_levels_of_a_way_out_go_together(client: Client, folder: Path) -> None:
    (folder / "rarms.yaml").write_text(TIGHT, encoding="utf-8", newline="\n")
    leave_curves(folder, 20.0, range(20, 101, 5))
    way = [{**LEVEL, "component": "speech", "level": "60 ms"}, {**LEVEL, "component": "talk", "level": "70 ms"}]
    for level in way:
        alone = client.post("levels", {"levels": [level]}).data
        assert "The headroom is not known" in str(alone["text"])

    shown = client.post("levels", {"levels": way}).data
    assert "The headroom is not known" not in str(shown["text"])
    assert str(shown["text"]).count("Headroom of onboard") == 1
    assert all(f"at_most: {level['level']}" in str(shown["difference"]) for level in way)
    (folder / "rarms.yaml").write_text(TIGHT + "# another hand\n", encoding="utf-8", newline="\n")
    late = client.post("levels", {"levels": way, "digest": shown["digest"]})
    assert (late.status, text(folder)) == (409, TIGHT + "# another hand\n")

    again = client.post("levels", {"levels": way}).data
    assert client.post("levels", {"levels": way, "digest": again["digest"]}).status == 200
    written = TIGHT.replace("at_most: 27 ms", "at_most: 60 ms").replace("at_most: 30 ms", "at_most: 70 ms")
    assert text(folder) == written + "# another hand\n"


def test_second_concurrent_level_is_refused(client: Client, folder: Path) -> None:
    for at in range(5):
        digest = client.post("levels", LEVELS).data["digest"]
        levels = [f"{40 - at} ms", f"{30 - at} ms"]
        bodies = [{"levels": [{**LEVEL, "level": level}], "digest": digest} for level in levels]
        with ThreadPoolExecutor(2) as pool:
            answers = list(pool.map(partial(client.post, "levels"), bodies))

        assert sorted(answer.status for answer in answers) == [200, 409]
        written = next(level for level, answer in zip(levels, answers, strict=True) if answer.status == 200)
        assert f"at_most: {written}" in text(folder)


def test_irregular_log_is_a_finding(client: Client, folder: Path) -> None:
    log = folder / "measurements" / "onboard" / "control" / "busy-loop.jsonl"
    log.mkdir(parents=True)

    page = client.get()

    assert page.status == 200
    assert "not a regular file" in page.text


def test_impossible_level_is_refused_with_reason(client: Client, folder: Path) -> None:
    refused = client.post("levels", {"levels": [LEVEL, {**LEVEL, "level": "45 parsecs"}]})

    assert refused.status == 409
    assert "mean_response_time" in str(refused.data["message"])
    assert client.post("levels", {"levels": [LEVEL, {**LEVEL, "component": "nothing"}]}).status == 409
    assert text(folder) == MANIFEST


def test_read_only_shows_and_plans_and_changes_nothing(folder: Path) -> None:
    with studio(folder, read_only=True) as client:
        client.enter()
        assert done(client, "plan")["ending"] == "done"
        digest = client.post("levels", LEVELS).data["digest"]
        assert client.post("levels", {**LEVELS, "digest": digest}).status == 403
        for action in [name for name, kind in ACTIONS.items() if kind.changes]:
            body = {"application": "x"} if action in {"apply", "finish", "undo"} else {}
            body |= {"plan": "x"} if action == "apply" else {}
            assert client.post(f"do/{action}", body).status == 403, action
    assert text(folder) == MANIFEST
    assert not (folder / "measurements").exists()


def test_manifest_errors_are_shown_and_fixed(client: Client, folder: Path) -> None:
    nasty = "</script><script>alert(1)</script>"
    (folder / "rarms.yaml").write_text(MANIFEST + f'\n"{nasty}": 1\n', encoding="utf-8", newline="\n")
    broken = client.get()
    assert broken.status == 200
    assert nasty not in broken.text
    assert "RARMS" in broken.text

    (folder / "rarms.yaml").write_text(MANIFEST, encoding="utf-8", newline="\n")
    assert 'data-measure="control"' in client.get().text


def test_missing_or_broken_manifest_is_named(client: Client, folder: Path) -> None:
    for content in (None, "schema: [", MANIFEST + "\nunknown: 1\n"):
        (folder / "rarms.yaml").unlink(missing_ok=True)
        if content is not None:
            (folder / "rarms.yaml").write_text(content, encoding="utf-8", newline="\n")
        page = client.get().text

        assert "rarms.yaml</h1>" in page
        assert page.count("<details") == page.count(" open>") == 1, "the finding is not folded"
        assert 'id="hosts"' not in page
        assert "Nothing is measured yet" not in page
    shown = client.get().text
    assert "| unknown: 1\n" in shown, "the line of the file"
    assert " | ^^^^^^^" in shown


def test_used_plan_is_no_longer_offered(client: Client, folder: Path) -> None:
    assert done(client, "plan")["ending"] == "done"
    assert 'data-action="apply"' in client.get().text

    assert rarms("apply", "--auto-approve", "-f", str(folder)).code == 0

    page = client.get().text
    assert "onboard changed since this plan was made. Plan again." in page
    assert 'data-action="apply"' not in page


def left_by_a_killed_measurement(folder: Path) -> None:
    """What a measurement needs on the host."""
    killed(30, "measure", "control", "--from", "50%", "--to", "50%", "-f", str(folder))
    assert "test partition" in rarms("status", "-f", str(folder)).out


def killed(at: int, *words: str) -> None:
    """Run a command that ends without clean-up at its effect of this number."""
    with disk.use(CrashingDisk(at)), pytest.raises(Crash):
        rarms(*words)


def test_running_measurement_is_not_cut_off(client: Client, folder: Path) -> None:
    left_by_a_killed_measurement(folder)
    assert 'data-action="plan-start"' in client.get().text

    with hold(folder / ".rarms" / "hosts" / "onboard.lock", "ann@lab, process 7"):
        page, status = client.get().text, rarms("status", "-f", str(folder)).out

    assert "ann@lab, process 7, measures on onboard." in page
    assert "ann@lab, process 7, measures on onboard." in status
    assert "cut off" not in page + status
    assert 'data-action="plan-start"' not in page
    assert 'data-action="plan-start"' in client.get().text


def test_running_apply_is_not_offered(client: Client, folder: Path) -> None:
    killed(70, "apply", "--auto-approve", "-f", str(folder))
    assert 'data-action="finish"' in client.get().text

    with hold(folder / ".rarms" / "hosts" / "onboard.lock", "ann@lab, process 7"):
        page = client.get().text

    assert "ann@lab, process 7, applies a plan on onboard." in page
    assert 'data-action="finish"' not in page


def test_stop_means_the_use_case_that_was_shown(client: Client, folder: Path) -> None:
    slow = MANIFEST.replace("    memory: 512 MiB", f"    {RUN}\n    memory: 512 MiB", 1)
    (folder / "rarms.yaml").write_text(slow, encoding="utf-8", newline="\n")
    assert done(client, "plan")["number"] == 1
    assert client.post("do/measure", {"components": ["control"], "first": 10, "last": 80, "step": 1}).status == 200

    assert client.post("stop", {"number": 1}).status == 200
    assert client.work()["ending"] == ""
    assert client.post("stop", {"number": 2}).status == 200
    assert client.work("stopped")["number"] == 2


def test_events_tell_of_files_that_changed(client: Client, folder: Path) -> None:
    connection = HTTPConnection("127.0.0.1", client.port, timeout=60)
    connection.request("GET", f"{client.path}events", headers={"Cookie": client.cookie})
    lines = connection.getresponse()
    seen: list[str] = []
    while len(seen) < 2:
        if lines.readline().decode().strip() == "event: files":
            seen.append(lines.readline().decode().strip().removeprefix("data: "))
            if len(seen) == 1:
                (folder / "rarms.yaml").write_text(MANIFEST + "# later\n", encoding="utf-8", newline="\n")
    connection.close()

    assert seen[0] != seen[1]
    assert f'data-version="{seen[1]}"' in client.get().text


def test_page_follows_use_cases_at_once(client: Client) -> None:
    connection = HTTPConnection("127.0.0.1", client.port, timeout=60)
    connection.request("GET", f"{client.path}events", headers={"Cookie": client.cookie})
    lines = connection.getresponse()
    sent: list[tuple[str, str]] = []
    while not any(name == "files" and data.startswith("1done-") for name, data in sent):
        if (line := lines.readline().decode()).startswith("event: "):
            sent.append(
                (line.strip().removeprefix("event: "), lines.readline().decode().strip().removeprefix("data: "))
            )
            if len(sent) == 2:  # as it was when the page was opened
                assert client.post("do/measure", {"components": ["control"]}).status == 200
    connection.close()

    states = [f"{state['number']}{state['ending']}" if (state := _state(each)) else "" for each in sent]
    for moment in ("1", "1done"):
        name, version = sent[states.index(moment) + 1]
        assert (name, version.partition("-")[0]) == ("files", moment)


def _state(sent: tuple[str, str]) -> dict[str, object] | None:
    name, data = sent
    return json.loads(data) if name == "work" else None
