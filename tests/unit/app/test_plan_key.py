"""With a key, only what was planned with it is done."""

import json
import os
from pathlib import Path

import pytest
import yaml

from rarms_iac.app.plan_files import FILE_VARIABLE, VARIABLE, plan_key
from rarms_iac.app.use_case_errors import RequestError
from tests.unit.cli.running import Ran, rarms

KEY = "0123456789abcdef"


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    assert rarms("init", str(tmp_path), "--name", "robot").code == 0
    return tmp_path / "rarms.yaml"


def test_without_a_key_none_is_needed() -> None:
    assert plan_key({}) is None


@pytest.mark.needs("posix")
def test_key_comes_from_variable_or_owners_file(tmp_path: Path) -> None:
    file = tmp_path / "key"
    file.write_text(f"{KEY}\n", encoding="ascii")
    file.chmod(0o600)

    assert plan_key({VARIABLE: KEY}) == plan_key({FILE_VARIABLE: str(file)}) == KEY.encode()
    file.chmod(0o640)
    with pytest.raises(RequestError, match="other than the owner"):
        plan_key({FILE_VARIABLE: str(file)})


@pytest.mark.needs("root")
def test_a_key_file_of_another_user_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "key"
    file.write_text(KEY, encoding="ascii")
    file.chmod(0o600)
    os.chown(file, 65534, 65534)

    with pytest.raises(RequestError, match="belongs to another user"):
        plan_key({FILE_VARIABLE: str(file)})


@pytest.mark.parametrize(
    ("environment", "message"),
    [
        ({VARIABLE: KEY, FILE_VARIABLE: "x"}, "both set"),
        ({VARIABLE: KEY[1:]}, "has 15 bytes"),
        ({VARIABLE: ""}, "has 0 bytes"),
        ({FILE_VARIABLE: "nothing-there"}, "nothing-there"),
        ({FILE_VARIABLE: "a\0b"}, "null"),
    ],
)
def test_a_key_that_is_none_is_wrong_usage(environment: dict[str, str], message: str) -> None:
    with pytest.raises(RequestError, match=message):
        plan_key(environment)


def test_a_plan_without_a_fitting_signature_is_refused(
    robot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    unsigned, signed = str(tmp_path / "unsigned.plan"), str(tmp_path / "signed.plan")
    assert rarms("plan", "-f", str(robot), "--out", unsigned).code == 0
    monkeypatch.setenv(VARIABLE, KEY)
    assert rarms("plan", "-f", str(robot), "--out", signed).code == 0

    refused = rarms("apply", unsigned)
    monkeypatch.setenv(VARIABLE, KEY[::-1])
    of_another_key = rarms("apply", signed)
    monkeypatch.setenv(VARIABLE, KEY)
    done = rarms("apply", signed)

    assert (refused.code, of_another_key.code, done.code) == (3, 3, 0)
    assert "error[RARMS341]" in refused.err
    assert "error[RARMS341]" in of_another_key.err
    monkeypatch.setenv(VARIABLE, "short")
    assert rarms("apply", signed).code == 64


def test_the_signature_covers_the_whole_file(robot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also what changes nothing that the plan does."""
    plan = tmp_path / "some.plan"
    monkeypatch.setenv(VARIABLE, KEY)
    assert rarms("plan", "-f", str(robot), "--out", str(plan)).code == 0
    document = json.loads(plan.read_bytes())
    document["inputs"]["versions"]["highspy"] += ".1"
    plan.write_text(json.dumps(document), encoding="utf-8")

    refused = rarms("apply", str(plan))
    monkeypatch.delenv(VARIABLE)
    scripts = rarms("show", str(plan), "--script")
    done = rarms("apply", str(plan))

    assert (refused.code, scripts.code, done.code) == (3, 64, 0)
    assert "error[RARMS341]" in refused.err
    assert "Set RARMS_PLAN_KEY" in scripts.err


def demand_signatures(manifest: Path) -> None:
    document = yaml.safe_load(manifest.read_text(encoding="utf-8"))
    document.setdefault("policy", {})["signed_plans"] = True
    manifest.write_text(yaml.safe_dump(document), encoding="utf-8")


@pytest.mark.parametrize("words", [("-f", "{manifest}", "--auto-approve"), ("{plan}",)])
def test_signed_plans_policy_needs_a_key(
    robot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]
) -> None:
    demand_signatures(robot)
    plan = str(tmp_path / "some.plan")
    apply = ["apply", *(word.format(manifest=robot, plan=plan) for word in words)]
    unsigned = rarms("plan", "-f", str(robot), "--out", plan)

    refused = rarms(*apply)
    monkeypatch.setenv(VARIABLE, KEY)
    signed = rarms("plan", "-f", str(robot), "--out", plan)
    done = rarms(*apply)

    told = ["It is not signed" in " ".join(planned.err.split()) for planned in (unsigned, signed)]
    assert (unsigned.code, signed.code, told) == (0, 0, [True, False])

    assert (refused.code, done.code) == (3, 0)
    assert "has `signed_plans: true`, but no key is set" in " ".join(refused.err.split())


def test_plan_forged_to_need_no_key_is_refused(robot: Path, tmp_path: Path) -> None:
    plan = str(tmp_path / "some.plan")
    assert rarms("plan", "-f", str(robot), "--out", plan).code == 0
    demand_signatures(robot)

    refused = rarms("apply", plan)

    assert refused.code == 3
    assert "error[RARMS341]" in refused.err


@pytest.mark.parametrize("command", ["apply", "undo"])
@pytest.mark.parametrize(
    ("begun_with", "is_demanded", "key", "code"),
    [("", False, "", 0), ("", False, KEY, 3), (KEY, False, KEY, 0), (KEY, True, KEY, 0), (KEY, True, "", 3)],
)
def test_unfinished_run_needs_its_key(
    robot: Path, monkeypatch: pytest.MonkeyPatch, command: str, begun_with: str, is_demanded: bool, key: str, code: int
) -> None:
    def run(verb: str, with_key: str) -> Ran:
        with monkeypatch.context() as context:
            if with_key:
                context.setenv(VARIABLE, with_key)
            return rarms(verb, "-f", str(robot), "--auto-approve")

    if is_demanded:
        demand_signatures(robot)
    for verb in ("apply", command) if command == "undo" else ("apply",):
        assert run(verb, begun_with).code == 0
    (journal,) = (robot.parent / ".rarms" / "hosts").glob("*.journal.jsonl")
    unfinished = b"".join(journal.read_bytes().splitlines(keepends=True)[:-1])
    journal.write_bytes(unfinished)

    answer = run(command, key)

    assert answer.code == code
    assert ("error[RARMS341]" in answer.err, journal.read_bytes() == unfinished) == (bool(code), bool(code))
