"""The studio in a real browser: a whole session by clicks and keys, its interruptions, and who else may not take part.

RARMS_PICTURES=FOLDER keeps pictures of the page, to be looked at.
"""

import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from tests.browser import chromium, looks, messages, whole_page
from tests.needs import CHECKOUT

if TYPE_CHECKING:
    from selenium.webdriver.chrome.webdriver import WebDriver
    from selenium.webdriver.remote.webelement import WebElement

pytestmark = pytest.mark.needs("chromium")

LONGEST = 120.0
"""Seconds to wait for words; a machine may be busy."""
RARMS = (sys.executable, "-m", "rarms_iac.cli.main")

SLOW = """\
schema: rarms/v1
application: { name: slow }
hosts:
  onboard: { logical_processors: 2, memory: 8 GiB }
components:
  vision:
    criticality: 30
    apt: { p99_response_time: { at_most: 60 ms } }  # the line is not too late
    run: { command: [vision], until: { samples: 20000 }, samples: { from: per_run } }
    cpu: { reserve: measured }
    memory: 512 MiB
    simulation: { work: 20 ms, varies: 30 % }
policy: { interference: [busy-loop] }
"""


class Studio:
    """`rarms studio` in a process of its own, in a folder."""

    def __init__(self, folder: Path, *options: str) -> None:
        self.folder = folder
        words = [*RARMS, "studio", "--no-open", *options]
        environment = {**os.environ, "PYTHONPATH": str(CHECKOUT)}
        self.process = subprocess.Popen(
            words, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        assert self.process.stdout is not None
        self.address = self.process.stdout.readline().strip()
        assert self.address.startswith("http://127.0.0.1:"), self.process.communicate()

    @property
    def page(self) -> str:
        return self.address.partition("enter")[0]

    def closes(self) -> int:
        """Ctrl-C."""
        self.process.terminate()
        self.process.communicate(timeout=LONGEST)
        return self.process.returncode


@contextmanager
def studio(folder: Path, *options: str) -> Iterator[Studio]:
    served = Studio(folder, *options)
    try:
        yield served
    finally:
        served.process.kill()
        served.process.communicate(timeout=LONGEST)


def rarms(folder: Path, *words: str) -> str:
    """A terminal beside the page."""
    environment = {**os.environ, "PYTHONPATH": str(CHECKOUT)}
    done = subprocess.run([*RARMS, *words], cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator["WebDriver"]:
    with chromium(tmp_path_factory.mktemp("profile")) as driver:
        yield driver


def waits_for(page: "WebDriver", script: str, *values: object) -> Any:
    """Until a script answers with something; its answer."""
    until = time.monotonic() + LONGEST
    while not (answer := page.execute_script(script, *values)):
        assert time.monotonic() < until, f"{script}: {page.find_element('id', 'work').text}"
        time.sleep(0.05)
    return answer


def waits_for_end(page: "WebDriver", command: str) -> str:
    """Until the command ended that does the same; how it ended."""
    ended = """
        const [command] = arguments, text = (id) => document.getElementById(id).textContent;
        const status = text("work-status");
        return text("work-command") === command && status !== "" && status !== "runs." ? status : null;
    """
    return str(waits_for(page, ended, command))


def shown(page: "WebDriver", name: str) -> str:
    return str(page.execute_script("return document.getElementById(arguments[0])?.textContent ?? ''", name))


def button(page: "WebDriver", form: str) -> "WebElement":
    return page.find_element("css selector", f"#{form} button:last-of-type")


def keeps(page: "WebDriver", name: str, width: int = 1200) -> None:
    if folder := os.environ.get("RARMS_PICTURES"):
        Path(folder, f"studio-{name}.png").write_bytes(whole_page(page, width))


def test_a_session_from_an_empty_folder_to_a_proven_plan(browser: "WebDriver", tmp_path: Path) -> None:
    from selenium.webdriver import ActionChains, Keys

    folder = tmp_path / "robot"
    folder.mkdir()
    rarms(folder, "init")
    manifest = folder / "rarms.yaml"
    before = manifest.read_text(encoding="utf-8")
    name = json.loads(rarms(folder, "status", "--json"))["application"]
    with studio(folder) as served:
        looks(browser, width=1200)
        browser.get(served.address)
        waits_for(browser, "return location.pathname.endsWith('/') && document.getElementById('components')")

        browser.find_element("css selector", "[data-measure=control]").click()
        assert waits_for_end(browser, "rarms measure control") == "ended."
        line = waits_for(browser, "return document.getElementById('m1-1-line')")

        height = int(browser.execute_script("return document.getElementById('m1-1-field').clientHeight"))
        browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", line)
        ActionChains(browser, duration=0).click_and_hold(line).move_by_offset(0, height // 3).perform()
        ActionChains(browser, duration=0).release().perform()
        level = line.get_attribute("aria-valuenow")
        assert 0 < float(level) < 50
        browser.find_element("css selector", "[data-preview=m1]").click()
        difference = waits_for(
            browser, "return document.querySelector('#m1 .edit:not([hidden]) .difference')?.textContent"
        )
        assert f"+      mean_response_time: {{ at_most: {level} ms }}" in difference
        assert manifest.read_text(encoding="utf-8") == before, "a preview writes nothing"
        keeps(browser, "difference")
        browser.find_element("css selector", "#m1 .edit .write").click()
        waits_for(
            browser, "return document.getElementById('components').textContent.includes(arguments[0])", f"{level} ms"
        )
        after = manifest.read_text(encoding="utf-8")
        assert after == before.replace("at_most: 50 ms", f"at_most: {level} ms")

        button(browser, "plan").send_keys(Keys.ENTER)
        assert waits_for_end(browser, "rarms plan") == "ended."
        waits_for(browser, "return document.getElementById('apply-application')")
        typed = browser.find_element("id", "apply-application")
        typed.send_keys("another", Keys.ENTER)
        assert waits_for_end(browser, "rarms apply") == "ended with problems."
        assert "is not the application's name" in shown(browser, "work-lines")
        typed = browser.find_element("id", "apply-application")
        typed.clear()
        typed.send_keys(name, Keys.ENTER)
        waits_for(browser, "return document.getElementById('work-status').textContent === 'ended.'")
        assert "1 of " in shown(browser, "work-rows")
        waits_for(browser, "return document.getElementById('hosts').textContent.includes('running')")

        button(browser, "prove").click()
        assert waits_for_end(browser, "rarms prove") == "ended with problems."
        browser.find_element("id", "prove-load_host").send_keys(Keys.SPACE)
        assert "rarms prove --load-host" in browser.find_element("id", "prove").text
        button(browser, "prove").click()
        assert waits_for_end(browser, "rarms prove --load-host") == "ended."
        waits_for(browser, "return document.getElementById('proof')")
        keeps(browser, "proven")
        assert served.closes() == 0
    status = json.loads(rarms(folder, "status", "--json"))
    assert {proof["met"] for proof in status["proofs"]} == {True}
    assert messages_of_errors(browser) == []


def messages_of_errors(page: "WebDriver") -> list[str]:
    """What the browser complained of, but for the server that was closed, and answers that say no."""
    return [text for text in messages(page, "browser") if not re.search(r"ERR_|status of 409", text)]
