"""`rarms studio` as a process: the browser it opens, what it says where it cannot serve, and its end."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.needs import CHECKOUT

RARMS = (sys.executable, "-m", "rarms_iac.cli.main")
LONGEST = 120.0
MANIFEST = (CHECKOUT / "templates/init/rarms.yaml").read_text(encoding="utf-8")

BROWSER = """\
#!{python}
import json, pathlib, re, sys, time, urllib.parse, urllib.request
page = pathlib.Path(urllib.parse.unquote(urllib.parse.urlsplit(sys.argv[1]).path))
target = re.search('href="([^"]+)"', page.read_text()).group(1)
with urllib.request.urlopen(target) as answer:
    status = answer.status
seen = dict(words=sys.argv[1:], page=str(page), target=target, status=status)
seen.update(modes=[path.stat().st_mode & 0o777 for path in (page, page.parent)])
pathlib.Path("seen.new").write_text(json.dumps(seen))
pathlib.Path("seen.new").rename("seen.json")
while not pathlib.Path("ends").exists():  # a browser that is waited for, as those of a terminal are
    time.sleep(0.05)
"""
"""Notes what it was given, and enters as a browser does."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "rarms.yaml").write_text(MANIFEST, encoding="utf-8", newline="\n")
    return tmp_path


def environment(**values: str) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(CHECKOUT), **values}


def ended(folder: Path, words: Sequence[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(words, cwd=folder, env=environment(), capture_output=True, text=True, timeout=LONGEST)


@pytest.mark.needs("posix")
def test_browser_gets_a_private_file_and_no_secret(folder: Path) -> None:
    browser = folder / "browser"
    browser.write_text(BROWSER.format(python=sys.executable), encoding="utf-8")
    browser.chmod(0o700)
    server = subprocess.Popen(
        [*RARMS, "studio"], cwd=folder, env=environment(BROWSER=str(browser)), stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        until = time.monotonic() + LONGEST
        while not (folder / "seen.json").exists():
            assert server.poll() is None, server.communicate()
            assert time.monotonic() < until
            time.sleep(0.05)
        server.send_signal(signal.SIGINT)
        server.wait(timeout=LONGEST)  # also while the browser is open
    finally:
        (folder / "ends").touch()
        server.kill()
    output, talk = server.communicate(timeout=LONGEST)
    seen = json.loads((folder / "seen.json").read_text(encoding="utf-8"))

    assert seen["words"] == [Path(seen["page"]).as_uri()], "the list of processes shows a file, not the address"
    assert seen["target"].startswith("http://127.0.0.1:")
    assert "token=" in seen["target"]
    assert seen["status"] == 200
    assert seen["modes"] == [0o600, 0o700]
    assert (server.returncode, output) == (0, "")
    assert f"open {seen['page']}" in talk
    assert "token=" not in talk
    assert not Path(seen["page"]).parent.exists()


def test_installation_without_extra_says_what_to_install(folder: Path) -> None:
    lacking = (
        "import sys; sys.modules.update(starlette=None, uvicorn=None); sys.argv[1:] = ['studio', '--no-open']; "
        "from rarms_iac.cli.main import main; sys.exit(main())"
    )
    refused = ended(folder, [sys.executable, "-c", lacking])

    assert (refused.returncode, refused.stdout) == (64, "")
    assert "rarms studio needs a package that is not installed: starlette, uvicorn" in refused.stderr
    said = " ".join(refused.stderr.split())
    assert "run `pipx install --force '.[studio]'`. If rarms runs from its .venv, run `.venv/bin/pip install" in said


def test_a_port_that_is_taken_is_named(folder: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        refused = ended(folder, [*RARMS, "studio", "--no-open", "--port", port])

    assert (refused.returncode, refused.stdout) == (64, "")
    assert f"Port {port} cannot be used" in refused.stderr
    assert "Choose another with --port" in refused.stderr
