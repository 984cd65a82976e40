"""What teams run on pull requests: pre-commit for real, and the steps of `action.yml` as they stand."""

import json
import os
import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
import yaml

from scripts.pull_request_comment import main as write_comment
from tests.needs import CHECKOUT

PAGE = CHECKOUT / "docs" / "pull-requests.md"

MANIFEST = """schema: rarms/v1

application:
  name: cell

hosts:
  onboard: { logical_processors: 2, memory: 4 GiB, keep_for_host: { memory: 1 GiB } }

components:
  vision:
    criticality: 3
    memory: 512 MiB
    cpu: { reserve: 40 % }
"""


def git(folder: Path, *words: str) -> str:
    command = ["git", "-c", "user.name=t", "-c", "user.email=t@example.org", "-c", "protocol.file.allow=always", *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True).stdout.strip()


def repository(folder: Path, manifest: str = MANIFEST) -> Path:
    """A team's repository with a manifest in it."""
    (folder / "cell").mkdir(parents=True)
    (folder / "cell" / "rarms.yaml").write_text(manifest, encoding="utf-8", newline="\n")
    git(folder, "init", "-q", "-b", "main")
    git(folder, "add", "-A")
    git(folder, "commit", "-qm", "A cell")
    return folder


@pytest.fixture(scope="module")
def rarms_repository(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """This checkout as it is now, as a repository with one commit."""
    folder = tmp_path_factory.mktemp("rarms")
    names = git(CHECKOUT, "ls-files", "--cached", "--others", "--exclude-standard", "-z").split("\0")
    for name in filter(None, names):
        if (CHECKOUT / name).is_file() and not name.startswith(("tests/", "benchmarks/")):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(CHECKOUT / name, folder / name)
    git(folder, "init", "-q")
    git(folder, "add", "-A")
    git(folder, "commit", "-qm", "As it is")
    return folder


@pytest.mark.needs("posix", "git", "network", "venv", "pre-commit")
def test_pre_commit_refuses_what_validate_refuses_and_formats(rarms_repository: Path, tmp_path: Path) -> None:
    folder = repository(tmp_path / "team")
    config = {
        "repo": rarms_repository.as_uri(),
        "rev": git(rarms_repository, "rev-parse", "HEAD"),
        "hooks": [{"id": "rarms-validate"}, {"id": "rarms-fmt"}],
    }
    (folder / ".pre-commit-config.yaml").write_text(yaml.safe_dump({"repos": [config]}), encoding="utf-8")
    git(folder, "add", "-A")

    def pre_commit() -> "subprocess.CompletedProcess[str]":
        command = [sys.executable, "-m", "pre_commit", "run", "--all-files"]
        home = {"PRE_COMMIT_HOME": str(tmp_path / "home"), "GIT_CONFIG_COUNT": "1"}
        allow = {"GIT_CONFIG_KEY_0": "protocol.file.allow", "GIT_CONFIG_VALUE_0": "always"}
        environment = {**os.environ, **home, **allow}
        return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)

    right = pre_commit()
    file = folder / "cell" / "rarms.yaml"
    file.write_text(MANIFEST.replace("40 %", "140   %"), encoding="utf-8", newline="\n")
    git(folder, "add", "-A")
    wrong = pre_commit()

    assert right.returncode == 0, right.stdout + right.stderr
    assert wrong.returncode == 1
    assert "error[RARMS0" in wrong.stdout
    assert "cell/rarms.yaml:13:" in wrong.stdout


@dataclass(frozen=True, slots=True, kw_only=True)
class Forge:
    """What a server calls its comments, as far as the script asks."""

    marker: str  # in a comment of a stranger
    comments: str  # the path of one of them begins so
    author: str
    author_key: tuple[str, str]  # of the stranger's comment
    header: tuple[str, str]
    posts_to: str = ""


GITHUB = Forge(
    marker="cell/rarms.yaml",
    comments="/repos/team/cell/issues/comments/",
    author="github-actions[bot]",
    author_key=("user", "login"),
    header=("Authorization", "Bearer t0ken"),
)
GITLAB = Forge(
    marker="cell",
    comments="/api/v4/projects/12/merge_requests/7/notes/",
    author="project_bot",
    author_key=("author", "username"),
    header=("PRIVATE-TOKEN", "t0ken"),
    posts_to="/api/v4/projects/12/merge_requests/7/notes",
)


class Comments(BaseHTTPRequestHandler):
    """The comments on one pull request; one of a stranger has our marker."""

    forge: Forge
    kept: list[dict[str, Any]]
    read_only = False
    broken = False

    def do_GET(self) -> None:
        if self.broken:
            self._answer(500, {})
            return
        stranger = {"id": 1, "body": f"<!-- rarms plan: {self.forge.marker} -->\nAll is well.", **self._by("stranger")}
        self._answer(200, [stranger, *self.kept] if self.path.endswith("&page=1") else [])

    def do_POST(self) -> None:
        assert not self.forge.posts_to or self.path == self.forge.posts_to
        comment = {"id": 2 + len(self.kept), **self._body(), "html_url": "https://example.org/new"}
        comment |= self._by(self.forge.author)
        if self.read_only:
            self._answer(403, {})
            return
        self.kept.append(comment)
        self._answer(201, comment)

    def do_PATCH(self) -> None:
        comment = next(each for each in self.kept if self.path == f"{self.forge.comments}{each['id']}")
        comment.update(self._body())
        self._answer(200, comment)

    do_PUT = do_PATCH  # noqa: N815 - as http.server calls it

    def log_message(self, *_: object) -> None:
        """Say nothing."""

    def _by(self, name: str) -> dict[str, dict[str, str]]:
        key, inner = self.forge.author_key
        return {key: {inner: name}}

    def _body(self) -> dict[str, Any]:
        name, value = self.forge.header
        assert self.headers[name] == value
        body: dict[str, Any] = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        return body

    def _answer(self, code: int, value: Any) -> None:
        self.send_response(code)
        self.end_headers()
        self.wfile.write(json.dumps(value).encode())


@contextmanager
def served(forge: Forge = GITHUB, **settings: object) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Serve a forge; its address, and the comments that it keeps."""
    kept: list[dict[str, Any]] = []
    handler = type("Handler", (Comments,), {"forge": forge, "kept": kept, **settings})
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}", kept
        server.shutdown()


def run_action(folder: Path, temporary: Path, api: str, *, installed: bool = True) -> dict[str, int]:
    """Run the shell steps of `action.yml` in their order as a runner does; the exit code of each that ran."""
    inputs = {"manifest": "cell/rarms.yaml", "snapshots": "onboard=host.json", "token": "t0ken"}
    action = yaml.safe_load((CHECKOUT / "action.yml").read_text(encoding="utf-8"))
    defaults = {name: value.get("default", "") for name, value in action["inputs"].items()}
    values = {f"inputs.{name}": value for name, value in {**defaults, **inputs}.items()}
    values["github.event.pull_request.number"] = "7"
    runner = {
        "RUNNER_TEMP": str(temporary),
        "GITHUB_ACTION_PATH": str(CHECKOUT),
        "GITHUB_STEP_SUMMARY": str(temporary / "summary.md"),
        "GITHUB_OUTPUT": str(temporary / "outputs"),
        "RUNNER_OS": "Linux",
        "RUNNER_ARCH": "X64",
        "GITHUB_API_URL": api,
        "GITHUB_REPOSITORY": "team/cell",
    }
    codes: dict[str, int] = {}
    for step in action["runs"]["steps"]:
        failed = any(codes.values())
        condition = step.get("if", "")
        if (failed and "always()" not in condition) or (installed and "cache-hit" in condition) or "uses" in step:
            continue
        assert step["shell"] == "bash"
        environment = {name: values[text.strip("${} ")] for name, text in step.get("env", {}).items()}
        script = ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step["run"]]
        done = subprocess.run(
            script, cwd=folder, env={**os.environ, **runner, **environment}, capture_output=True, text=True, check=False
        )
        (temporary / f"{step['name']}.log").write_text(done.stdout + done.stderr, encoding="utf-8")
        codes[step["name"]] = done.returncode
    return codes


@pytest.mark.needs("posix")
def test_action_environment_is_kept_while_unchanged(tmp_path: Path) -> None:
    steps = {
        step["name"]: step for step in yaml.safe_load((CHECKOUT / "action.yml").read_text("utf-8"))["runs"]["steps"]
    }
    action = tmp_path / "action"
    (action / "rarms_iac").mkdir(parents=True)

    def key(code: str, temporary: str = "/tmp/a") -> str:
        (action / "rarms_iac" / "code.py").write_text(code, encoding="utf-8")
        output = tmp_path / "output"
        output.write_text("", encoding="utf-8")
        runner = {"GITHUB_ACTION_PATH": str(action), "GITHUB_OUTPUT": str(output), "RUNNER_TEMP": temporary}
        environment = {**os.environ, **runner, "RUNNER_OS": "Linux", "RUNNER_ARCH": "X64"}
        script = steps["Name the environment"]["run"]
        subprocess.run(["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", script], env=environment, check=True)
        return output.read_text(encoding="utf-8")

    first = key("a = 1")

    assert re.fullmatch(r"key=rarms-Linux-X64-[0-9a-f]{64}\n", first)
    assert key("a = 1") == first
    assert len({first, key("a = 2"), key("a = 1", "/tmp/b")}) == 3
    kept = steps["Keep the environment"]
    assert kept["with"]["key"] == "${{ steps.environment.outputs.key }}"
    assert steps["Install rarms"]["if"] == f"steps.{kept['id']}.outputs.cache-hit != 'true'"


def test_strangers_comment_with_marker_is_left_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    body = tmp_path / "rarms.md"
    with served() as (api, comments):
        settings = {"GITHUB_API_URL": api, "GITHUB_REPOSITORY": "team/cell", "NUMBER": "7", "TOKEN": "t0ken"}
        for name, value in {**settings, "AUTHOR": "github-actions[bot]"}.items():
            monkeypatch.setenv(name, value)
        for text in ("first", "second"):
            body.write_text(f"<!-- rarms plan: cell/rarms.yaml -->\n{text}\n", encoding="utf-8")
            assert write_comment(str(body)) == 0

    assert [(comment["id"], comment["body"].splitlines()[1]) for comment in comments] == [(2, "second")]


@pytest.mark.parametrize("is_there", [False, True])
def test_server_that_does_not_answer_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *, is_there: bool
) -> None:
    body = tmp_path / "rarms.md"
    body.write_text("<!-- rarms plan: cell/rarms.yaml -->\n", encoding="utf-8")
    with served(broken=True) as (api, _):
        settings = {"GITHUB_API_URL": api if is_there else "http://127.0.0.1:1", "GITHUB_REPOSITORY": "team/cell"}
        for name, value in {**settings, "NUMBER": "7", "TOKEN": "t0ken", "AUTHOR": "github-actions[bot]"}.items():
            monkeypatch.setenv(name, value)
        code = write_comment(str(body))

    reason = "the server answered 500" if is_there else "the server could not be reached"
    (line,) = capsys.readouterr().out.splitlines()
    assert (code, reason in line) == (1, True)


@pytest.mark.needs("posix", "bash", "git", "network", "venv")
def test_the_action_validates_plans_and_keeps_one_comment(tmp_path: Path) -> None:
    origin = repository(tmp_path / "origin")
    snapshot = [sys.executable, "-m", "rarms_iac", "snapshot", "-f", "cell", "--out", "host.json"]
    subprocess.run(snapshot, cwd=origin, env={**os.environ, "PYTHONPATH": str(CHECKOUT)}, check=True)
    git(origin, "add", "-A")
    git(origin, "commit", "-qm", "What the host looks like")
    folder = tmp_path / "head"
    git(tmp_path, "clone", "-q", str(origin), str(folder))

    def runner(reserve: str, api: str, name: str) -> tuple[dict[str, int], Path]:
        """One run, for a pull request that asks for this reserve; rarms is installed by the first."""
        temporary = tmp_path / name
        temporary.mkdir()
        if name != "first":
            (temporary / "rarms").symlink_to(tmp_path / "first" / "rarms")
        text = MANIFEST.replace("40 %", reserve)
        (folder / "cell" / "rarms.yaml").write_text(text, encoding="utf-8", newline="\n")
        return run_action(folder, temporary, api, installed=name != "first"), temporary

    with served() as (api, comments):
        first, _ = runner("30 %", api, "first")
        second, of_second = runner("90 %", api, "second")
        wrong, of_wrong = runner("190 %", api, "wrong")
    with served(read_only=True) as (api, none):
        fork, of_fork = runner("30 %", api, "fork")

    assert first == dict.fromkeys(["Name the environment", "Install rarms", "Validate", "Plan", "Comment"], 0)
    assert set(second.values()) == set(fork.values()) == {0}
    assert [comment["id"] for comment in comments] == [2]
    body = comments[0]["body"]
    assert body.startswith("<!-- rarms plan: cell/rarms.yaml -->\n")
    assert "| onboard | + vision | 1.8 LP | 512 MiB |" in body
    assert "### rarms plan: cell" in (of_second / "summary.md").read_text(encoding="utf-8")
    assert (wrong["Validate"], "Plan" in wrong) == (2, False)
    assert "::error file=cell/rarms.yaml,line=13," in (of_wrong / "Validate.log").read_text(encoding="utf-8")
    assert none == []
    assert "may not comment" in (of_fork / "Comment.log").read_text(encoding="utf-8")


def block_of(language: str, first: str) -> str:
    """The block of the page that begins with this line."""
    blocks = re.findall(rf"^```{language}\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    (found,) = (block for block in blocks if block.startswith(first))
    return str(found)


def a_cell_with_a_snapshot(folder: Path) -> Path:
    """A team's repository as the page has it: a manifest of one host, and what the host looked like."""
    made = repository(folder, MANIFEST.replace("onboard:", "cell:").replace("name: cell", "name: demo"))
    (made / "snapshots").mkdir()
    run_lines(made, ["rarms snapshot -f cell --host cell --out snapshots/cell.json"], {})
    git(made, "add", "-A")
    git(made, "commit", "-qm", "What the host looks like")
    return made


def run_lines(folder: Path, lines: list[str], variables: dict[str, str]) -> None:
    """Run these lines one after another, as a runner does that has rarms installed."""
    bin_folder = folder.parent / "bin"
    bin_folder.mkdir(exist_ok=True)
    program = bin_folder / "rarms"
    program.write_text(
        f'#!/bin/sh\nPYTHONPATH="{CHECKOUT}" exec "{sys.executable}" -m rarms_iac "$@"\n', encoding="utf-8"
    )
    program.chmod(0o755)
    environment = {**os.environ, "PATH": f"{bin_folder}:{os.environ['PATH']}", **variables}
    for line in lines:
        done = subprocess.run(
            ["bash", "-eo", "pipefail", "-c", line],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, (line, done.stdout + done.stderr)


@pytest.mark.needs("posix", "bash", "git")
def test_pipeline_for_gitlab_reports_and_keeps_one_note(rarms_repository: Path, tmp_path: Path) -> None:
    job = yaml.safe_load(block_of("yaml", "# .gitlab-ci.yml"))["rarms"]
    installing = [line for line in job["script"] if line.startswith("pip install")]
    script = [line for line in job["script"] if line not in installing]
    (tmp_path / "server" / "OWNER").mkdir(parents=True)
    (tmp_path / "server" / "OWNER" / "rarms.git").symlink_to(rarms_repository)
    folder = a_cell_with_a_snapshot(tmp_path / "builds" / "cell")
    bodies: list[str] = []
    with served(GITLAB) as (address, notes):
        api = f"{address}/api/v4"
        known = {"CI_API_V4_URL": api, "CI_PROJECT_ID": "12", "CI_MERGE_REQUEST_IID": "7", "TOKEN": "t0ken"}
        known["CI_SERVER_URL"] = (tmp_path / "server").as_uri()
        own = {
            name: re.sub(r"\$(\w+)", lambda found: known[found[1]], str(text))
            for name, text in job["variables"].items()
        }
        for reserve in ("30 %", "60 %"):
            file = folder / "cell" / "rarms.yaml"
            text = re.sub("reserve: [0-9]+ %", f"reserve: {reserve}", file.read_text(encoding="utf-8"))
            file.write_text(text, encoding="utf-8", newline="\n")
            run_lines(folder, [*script, *job["after_script"]], {**known, **own})
            bodies.append(notes[0]["body"])

    assert installing == ["pip install --quiet ../rarms"]
    assert [note["id"] for note in notes] == [2]
    assert bodies[0].startswith("<!-- rarms plan: cell -->\n")
    assert ("0.6 LP" in bodies[0], "1.2 LP" in bodies[1]) == (True, True)
    assert "<testsuites" in (folder / job["artifacts"]["reports"]["junit"]).read_text(encoding="utf-8")


@pytest.mark.needs("posix", "bash", "git")
def test_steps_for_jenkins_leave_what_pipeline_publishes(tmp_path: Path) -> None:
    pipeline = block_of("groovy", "// Jenkinsfile")
    folder = a_cell_with_a_snapshot(tmp_path / "cell")

    run_lines(folder, re.findall(r"^ *sh '(.*)'$", pipeline, re.MULTILINE), {})

    published = re.findall(r"(?:testResults|artifacts): '([^']+)'", pipeline)
    assert published == ["rarms.xml", "comment.md"]
    assert all((folder / file).stat().st_size for file in published)
    assert pipeline.count("{") == pipeline.count("}")
