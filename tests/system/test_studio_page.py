"""The studio in a real browser: a whole session by clicks and keys, its interruptions, and who else may not take part.

RARMS_PICTURES=FOLDER keeps pictures of the page, to be looked at.
"""

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import chdir, contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any

import pytest

from tests.browser import chromium, looks, messages, whole_page
from tests.files import copy_files
from tests.needs import CHECKOUT, require
from tests.system.test_report_page import LEAST_CONTRAST
from tests.unit.cli import running
from tests.unit.studio.studio_client import TIGHT

if TYPE_CHECKING:
    from selenium.webdriver.chrome.webdriver import WebDriver

pytestmark = pytest.mark.needs("chromium")

LONGEST = 300.0
"""Seconds to wait for words; a machine may be busy."""
RARMS = (sys.executable, "-m", "rarms_iac.cli.main")

NAMES = ("vision", "speech", "paths", "arm", "wheels", "lidar", "maps", "talk")
COMPONENT = """\
  {name}:
    criticality: 10
    apt: {{ mean_response_time: {{ at_most: 60 ms }} }}
    run: {{ command: [{name}], until: {{ samples: 2000 }}, samples: {{ from: per_run }} }}
    cpu: {{ reserve: measured }}
    memory: 256 MiB
    simulation: {{ work: 20 ms, varies: 10 % }}
"""
SLOW = (
    "schema: rarms/v1\napplication: { name: slow }\nhosts:\n  onboard: { logical_processors: 2, memory: 8 GiB }\n"
    "policy: { interference: [busy-loop] }\ncomponents:\n" + "".join(COMPONENT.format(name=name) for name in NAMES)
)
"""Settings that take a second each, and many of them."""


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
    """Run a command in a terminal of this folder."""
    with chdir(folder):
        done = running.rarms(*words)
    assert done.code == 0, done.err
    return done.out


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the first manifest, whose component was measured; tests that change it take a copy."""
    folder = tmp_path_factory.mktemp("measured")
    rarms(folder, "init")
    rarms(folder, "measure", "control")
    return folder


@pytest.fixture
def robot(measured: Path, tmp_path: Path) -> Path:
    """A copy of that folder."""
    return copy_files(measured, tmp_path / "robot")


@pytest.fixture(scope="module")
def shared(measured: Path) -> Iterator["Studio"]:
    """The studio of that folder, for tests that only look."""
    with studio(measured) as served:
        yield served


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator["WebDriver"]:
    with chromium(tmp_path_factory.mktemp("profile")) as driver:
        yield driver


WATCH = """
    const [...values] = arguments, done = values.pop();
    const look = () => { const answer = read(...values); if (answer) { ended(); done(answer); } };
    const watch = new MutationObserver(look), timer = setInterval(look, 500);
    const ended = () => { watch.disconnect(); clearInterval(timer); };
    watch.observe(document, { subtree: true, childList: true, attributes: true, characterData: true });
    look();
"""
"""Look at the page after each of its changes; what no change shows is looked for twice a second."""


def waits_for(page: "WebDriver", script: str, *values: object) -> Any:
    """Wait until a script answers with something; its answer."""
    from selenium.common.exceptions import TimeoutException

    page.set_script_timeout(LONGEST)
    try:
        return page.execute_async_script(f"const read = function () {{ {script} }};\n{WATCH}", *values)
    except TimeoutException:
        raise AssertionError(f"{script}: {page.find_element('tag name', 'body').text}") from None


def waits_for_end(page: "WebDriver", command: str) -> str:
    """Until the command ended that does the same; how it ended."""
    ended = """
        const [command] = arguments, text = (id) => document.getElementById(id).textContent;
        const status = text("work-status");
        return text("work-command") === command && status !== "" && status !== "runs." ? status : null;
    """
    ending = str(waits_for(page, ended, command))
    waits_for(page, "return main.dataset.version.startsWith(work.dataset.state)")
    return ending


def shown(page: "WebDriver", name: str) -> str:
    return str(page.execute_script("return document.getElementById(arguments[0])?.textContent ?? ''", name))


def press(page: "WebDriver", form: str) -> None:
    """Press a form's button by keyboard, once it may be pressed: a page that is made again keeps the focus."""
    from selenium.common.exceptions import StaleElementReferenceException
    from selenium.webdriver import Keys

    button = f"#{form} button:last-of-type"
    for _ in range(20):
        waits_for(page, "return document.querySelector(arguments[0])?.disabled === false", button)
        page.execute_script("document.querySelector(arguments[0]).focus()", button)
        with suppress(StaleElementReferenceException):
            page.switch_to.active_element.send_keys(Keys.ENTER)
            return
    raise AssertionError(f"#{form} does not hold still")


def types(page: "WebDriver", field: str, text: str) -> None:
    """Into a field that has the focus, as by hand: a page that is made again meanwhile keeps both."""
    from selenium.webdriver import ActionChains, Keys

    page.execute_script("const field = document.getElementById(arguments[0]); field.value = ''; field.focus()", field)
    ActionChains(page).send_keys(text, Keys.ENTER).perform()


def keeps(page: "WebDriver", name: str, width: int = 1200) -> None:
    if folder := os.environ.get("RARMS_PICTURES"):
        Path(folder, f"studio-{name}.png").write_bytes(whole_page(page, width))


@pytest.mark.sample
def test_session_from_empty_folder_to_proven_plan(browser: "WebDriver", tmp_path: Path) -> None:
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
        waits_for(browser, ALIVE)

        browser.find_element("id", "measure-weak_load").click()
        row = browser.find_element("css selector", "[data-measure=control]")
        assert row.get_attribute("title") == "rarms measure control"
        row.click()
        assert waits_for_end(browser, "rarms measure control") == "ended.", "the boxes are those of another form"
        assert shown(browser, "work-title") == "Last command"
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
        assert "Written into the manifest." in browser.find_element("css selector", "#m1 .edit").text
        assert shown(browser, "work-message") == ""
        after = manifest.read_text(encoding="utf-8")
        assert after == before.replace("at_most: 50 ms", f"at_most: {level} ms")

        browser.find_element("css selector", "#plan button:last-of-type").send_keys(Keys.ENTER)
        assert waits_for_end(browser, "rarms plan") == "ended."
        waits_for(browser, "return document.getElementById('apply-application')")
        link = browser.find_element("css selector", "#next a")
        assert str(link.get_attribute("href")).endswith("#the-plan")
        assert link.text in browser.find_element("id", "plan-title").text.replace("Plan", "look at plan")
        types(browser, "apply-application", "another")
        assert waits_for_end(browser, "rarms apply") == "ended with problems."
        assert "is not the application's name" in shown(browser, "work-lines")
        types(browser, "apply-application", name)
        waits_for(browser, "return document.getElementById('work-status').textContent === 'ended.'")
        assert "1 of " in shown(browser, "work-rows")
        waits_for(browser, "return document.getElementById('hosts').textContent.includes('running')")
        waits_for(browser, "return main.dataset.version.startsWith(work.dataset.state)")  # its buttons work again

        press(browser, "prove")
        assert waits_for_end(browser, "rarms prove") == "ended with problems."
        browser.find_element("id", "prove-load_host").send_keys(Keys.SPACE)
        assert "rarms prove --load-host" in browser.find_element("id", "prove").text
        press(browser, "prove")
        assert waits_for_end(browser, "rarms prove --load-host") == "ended."
        waits_for(browser, "return document.getElementById('proof')")
        keeps(browser, "proven")
        assert served.closes() == 0
    status = json.loads(rarms(folder, "status", "--json"))
    assert {proof["proven"]["met"] for proof in status["proofs"]} == {True}
    assert messages_of_errors(browser) == []


FOCUSED = "const {id, dataset, className} = document.activeElement; return {id, className, ...dataset}"


def tabs_to(page: "WebDriver", within: str = "", **wanted: str) -> None:
    """Tab by Tab, as without a mouse, until such an element has the focus."""
    from selenium.webdriver import ActionChains, Keys

    inside = "return document.activeElement.closest(arguments[0]) !== null"
    for _ in range(400):
        focused = page.execute_script(FOCUSED)
        if wanted.items() <= focused.items() and (not within or page.execute_script(inside, within)):
            return
        ActionChains(page).send_keys(Keys.TAB).perform()
    raise AssertionError(f"no Tab reaches {wanted} {within}")


def test_a_session_by_keys_alone(browser: "WebDriver", tmp_path: Path) -> None:
    from selenium.webdriver import ActionChains, Keys

    def presses(*keys: str) -> None:
        ActionChains(browser).send_keys(*keys).perform()

    rarms(tmp_path, "init")
    manifest = tmp_path / "rarms.yaml"
    before = manifest.read_text(encoding="utf-8")
    name = json.loads(rarms(tmp_path, "status", "--json"))["application"]
    with studio(tmp_path) as served:
        opens(browser, served)
        tabs_to(browser, measure="control")
        presses(Keys.ENTER)
        assert waits_for_end(browser, "rarms measure control") == "ended."
        waits_for(browser, "return document.getElementById('m1-1-line')")

        tabs_to(browser, id="m1-1-line")
        presses(Keys.ARROW_DOWN * 3, Keys.PAGE_DOWN)
        level = browser.execute_script("return document.activeElement.getAttribute('aria-valuenow')")
        assert 0 < float(level) < 50
        tabs_to(browser, preview="m1")
        presses(Keys.ENTER)
        waits_for(browser, "return document.querySelector('#m1 .edit:not([hidden]) .write:not([hidden])')")
        tabs_to(browser, "#m1 .edit", className="write")
        presses(Keys.ENTER)
        waits_for(
            browser, "return document.getElementById('components').textContent.includes(arguments[0])", f"{level} ms"
        )
        assert manifest.read_text(encoding="utf-8") == before.replace("at_most: 50 ms", f"at_most: {level} ms")

        tabs_to(browser, "#plan button")
        presses(Keys.ENTER)
        assert waits_for_end(browser, "rarms plan") == "ended."
        waits_for(browser, "return document.getElementById('apply-application')")
        tabs_to(browser, id="apply-application")
        presses(name, Keys.ENTER)
        assert waits_for_end(browser, "rarms apply") == "ended."
        tabs_to(browser, id="prove-load_host")
        presses(Keys.SPACE)
        tabs_to(browser, "#prove button")
        presses(Keys.ENTER)
        assert waits_for_end(browser, "rarms prove --load-host") == "ended."
        waits_for(browser, "return document.getElementById('proof')")
        tabs_to(browser, "#m1 summary")
        presses(Keys.ENTER)
        tabs_to(browser, setting="0")
        presses(Keys.ENTER)
        assert "response times at a reserve of" in shown(browser, "m1-1-samples")
    status = json.loads(rarms(tmp_path, "status", "--json"))
    assert {proof["proven"]["met"] for proof in status["proofs"]} == {True}


def test_setting_samples_and_script_difference_are_shown(browser: "WebDriver", robot: Path) -> None:
    rarms(robot, "apply", "--auto-approve")
    manifest = robot / "rarms.yaml"
    text = manifest.read_text(encoding="utf-8")
    manifest.write_text("memory: 768 MiB".join(text.rsplit("memory: 512 MiB", 1)), encoding="utf-8", newline="\n")
    with studio(robot) as served:
        opens(browser, served)
        waits_for(browser, "return document.getElementById('m1-setting') !== null")
        words = "return document.querySelector('#m1 form.setting code').textContent"
        browser.find_element("id", "m1-setting").send_keys("77")
        assert browser.execute_script(words) == "rarms measure control --from 77% --to 77%"
        browser.find_element("css selector", "#measure-components [data-key=control]").click()
        for box in ("on_busy_host", "stop_partitions", "coarse"):
            browser.find_element("id", f"measure-{box}").click()
        assert "--interactive --stop-partitions" in browser.find_element("id", "measure").text
        browser.find_element("id", "measure-first").send_keys("77")
        types(browser, "measure-last", "77")
        assert waits_for_end(browser, "rarms measure control --from 77% --to 77% --stop-partitions") == "ended."
        row = (
            "return [...document.querySelectorAll('#m1 [data-setting]')].find((each) => /77 %/.test(each.textContent))"
        )
        waits_for(browser, row)
        browser.execute_script("document.querySelectorAll('#m1 details').forEach((each) => (each.open = true))")
        browser.execute_script(row).click()
        assert "at a reserve of 77 %" in shown(browser, "m1-1-samples")
        bars = browser.find_elements("css selector", "#m1-1-samples rect")
        assert any(bar.size["height"] > 0 for bar in bars)
        browser.find_element("id", "m1-1-line").send_keys("\ue011")  # Home: away from the dot of the least reserve
        others = "[...document.querySelectorAll('#m1 .dot')].filter((each) => !/77 %/.test(each.textContent))"
        browser.execute_script(f"return {others}.at(-1)").click()  # the last one, as no other lies on it
        assert "at a reserve of 77 %" not in shown(browser, "m1-1-samples")

        press(browser, "plan")
        assert waits_for_end(browser, "rarms plan") == "ended."
        waits_for(browser, "return document.getElementById('the-plan') !== null")
        planned = shown(browser, "plan-text")
        assert "display" in planned
        assert "512 MiB -> 768 MiB" in planned
        assert "Afterwards" in planned
        assert browser.find_element("id", "plan-text").is_displayed(), "what is to be applied is read before"
        browser.find_element("css selector", "#the-plan details:nth-of-type(2) summary").click()
        script = browser.find_element("css selector", "#the-plan details[open]").text
        assert "which was applied last" in script
        assert "- partition/display, step 6: start it" in script
        keeps(browser, "script")


NASTY = "</pre><img src=x onerror='window.hit=1'><script>window.hit=1</script>"


def test_hostile_text_that_comes_by_script_is_text(browser: "WebDriver", robot: Path) -> None:
    manifest = robot / "rarms.yaml"
    text = manifest.read_text(encoding="utf-8").replace("      mean_response", f"      # {NASTY}\n      mean_response")
    text = text.replace("# description: The purpose, in one sentence.", f'description: "{NASTY}"')
    manifest.write_text(text, encoding="utf-8", newline="\n")
    elements = "return [window.hit ?? 0, document.querySelectorAll('img, script:not([type])').length]"
    with studio(robot) as served:
        opens(browser, served)
        assert NASTY in browser.find_element("tag name", "header").text
        browser.find_element("id", "m1-1-line").send_keys("\ue015")  # arrow down
        browser.find_element("css selector", "[data-preview=m1]").click()
        waits_for(browser, "return document.querySelector('#m1 .edit:not([hidden])')")
        assert NASTY in browser.find_element("css selector", "#m1 .difference").text
        press(browser, "plan")
        assert waits_for_end(browser, "rarms plan") == "ended."
        waits_for(browser, "return document.getElementById('apply-application')")
        types(browser, "apply-application", NASTY)
        assert waits_for_end(browser, "rarms apply") == "ended with problems."
        assert "window.hit=1" in shown(browser, "work-lines")
        assert browser.execute_script(elements) == [0, 0]


def test_reopened_browser_finds_what_runs(slow: Path, tmp_path: Path) -> None:
    with studio(slow) as served:
        with chromium(tmp_path / "profile") as first:
            opens(first, served)
            press(first, "measure")
            waits_for(first, "return document.getElementById('work-rows').textContent.includes('samples')")
            setting = waits_for(first, SETTING)
        with chromium(tmp_path / "profile") as again:
            opens(again, served)  # by the first address, whose token was used
            waits_for(again, "return document.getElementById('work-status').textContent === 'runs.'")
            assert shown(again, "work-command") == "rarms measure"
            waits_for(again, ANOTHER_SETTING, setting)
            again.find_element("id", "work-stop").click()
            assert waits_for_end(again, "rarms measure") == "was stopped."
        with chromium(tmp_path / "another") as another:
            for address in (served.address, served.page):
                another.get(address)
                waits_for(another, "return document.body.textContent.includes('403')")


def messages_of_errors(page: "WebDriver") -> list[str]:
    """What the browser complained of, but for the server that was closed, and answers that say no."""
    return [text for text in messages(page, "browser") if not re.search(r"ERR_|status of 409", text)]


@pytest.fixture
def slow(tmp_path: Path) -> Path:
    """A folder whose component takes long to measure."""
    folder = tmp_path / "slow"
    folder.mkdir()
    (folder / "rarms.yaml").write_text(SLOW, encoding="utf-8", newline="\n")
    return folder


SETTING = "return document.querySelector('#work-rows tr:last-child td:nth-child(2)')?.textContent"
ANOTHER_SETTING = f"const now = (() => {{ {SETTING} }})(); return now && now !== arguments[0]"
ALIVE = "return document.getElementById('components') !== null && document.readyState === 'complete'"
"""Its scripts have run: what is pressed before that is lost."""


def opens(page: "WebDriver", served: Studio) -> None:
    looks(page, width=1200)
    messages(page, "browser")  # what an earlier test left is read, and not counted
    page.get(served.address)
    waits_for(page, ALIVE)


def test_seven_pages_work_and_the_last_one_stops(browser: "WebDriver", slow: Path) -> None:
    """A browser has six connections to a server. Windows side by side are all visible; the first tab is not."""
    first = browser.current_window_handle
    with studio(slow) as served:
        opens(browser, served)
        press(browser, "measure")
        try:
            for kind in ("tab", *["window"] * 5):
                browser.switch_to.new_window(kind)
                browser.get(served.page)
                waits_for(browser, "return document.getElementById('work-status').textContent === 'runs.'")
            browser.find_element("id", "work-stop").click()
            for window in reversed(browser.window_handles):
                browser.switch_to.window(window)
                assert waits_for_end(browser, "rarms measure") == "was stopped."
        finally:
            for window in set(browser.window_handles) - {first}:
                browser.switch_to.window(window)
                browser.close()
            browser.switch_to.window(first)


def test_measurement_is_stopped_in_middle_and_goes_on(browser: "WebDriver", slow: Path) -> None:
    with studio(slow) as served:
        opens(browser, served)
        press(browser, "measure")
        waits_for(browser, "return document.getElementById('work-rows').textContent.includes('samples')")
        disabled = (
            "return [...document.querySelectorAll('#measure button, #tune button, #prove button, [data-measure]')]"
        )
        waits_for(browser, f"{disabled}.every((each) => each.disabled)")
        keeps(browser, "measuring")
        browser.find_element("id", "work-stop").click()
        assert waits_for_end(browser, "rarms measure") == "was stopped."
        assert "Run the same command to continue" in shown(browser, "work-lines")

        press(browser, "measure")
        waits_for(browser, "return document.getElementById('work-status').textContent === 'runs.'")
        waits_for(browser, ANOTHER_SETTING, waits_for(browser, SETTING))
        waits_for(browser, "return document.querySelector('#m1 .dot') !== null")
        assert shown(browser, "work-status") == "runs.", "curves come while it is measured"
        assert served.closes() == 0, "closed in the middle, it stops as in the terminal"
    assert "vision" in rarms(slow, "status")


def test_second_tab_and_terminal_beside_it_show_same(browser: "WebDriver", tmp_path: Path) -> None:
    rarms(tmp_path, "init")
    with studio(tmp_path) as served:
        opens(browser, served)
        first = browser.current_window_handle
        browser.switch_to.new_window("tab")
        second = browser.current_window_handle
        browser.get(served.page)
        waits_for(browser, "return document.getElementById('components') !== null")

        def both(script: str) -> list[Any]:
            """What the two tabs answer, once they have followed the files; at the latest after a while."""
            until = time.monotonic() + LONGEST
            while True:
                answers = []
                for tab in (first, second):
                    browser.switch_to.window(tab)
                    answers.append(waits_for(browser, script))
                if answers[0] == answers[1] or time.monotonic() > until:
                    return answers

        rarms(tmp_path, "measure", "control")
        measured = both("return document.getElementById('m1-1-line')?.outerHTML")
        press(browser, "plan")
        planned = both("return document.getElementById('the-plan')?.textContent")
        rarms(tmp_path, "apply", "--auto-approve")
        applied = both("return document.getElementById('history')?.textContent.includes('done')")
        browser.switch_to.window(second)
        browser.close()
        browser.switch_to.window(first)

    assert measured[0] == measured[1]
    assert planned[0] == planned[1]
    assert applied == [True, True]


def killed_while_measuring(served: Studio) -> None:
    """Kill the server while all test partitions run: they are made again for a component that uses one processor."""
    host = served.folder / ".rarms" / "hosts" / "onboard.json"
    for _ in range(1000):
        served.process.send_signal(signal.SIGSTOP)
        machines = json.loads(host.read_text(encoding="utf-8"))["machines"].values()
        running = {each["settings"]["name"] for each in machines if each["state"] == "running"}
        if running >= {"rarms-p1", "rarms-p2"} and len(running) == len(machines):
            break
        served.process.send_signal(signal.SIGCONT)
        time.sleep(0.01)
    served.process.kill()
    served.process.wait(timeout=LONGEST)


def test_killed_server_is_told_and_replaced(browser: "WebDriver", slow: Path) -> None:
    with studio(slow) as served:
        opens(browser, served)
        press(browser, "measure")
        waits_for(browser, "return document.getElementById('work-rows').textContent.includes('samples')")
        killed_while_measuring(served)
        waits_for(browser, "return !document.getElementById('connection').hidden")
        told = browser.find_element("id", "connection").text
        assert told.startswith(
            "The server is not running, and the running action ended with it. Start rarms studio again"
        )
        assert not browser.find_element("id", "work-stop").is_displayed()
        assert shown(browser, "work-status") == "was interrupted."
    with studio(slow) as again:
        opens(browser, again)
        assert "removes the test partitions of an interrupted measurement" in shown(browser, "next")
        assert "test partition, not counted; running, of slow" in shown(browser, "hosts")
        keeps(browser, "cut-off")
        browser.find_element("css selector", "#next button").click()
        browser.switch_to.active_element.click()
        assert waits_for_end(browser, "rarms start") == "ended.", shown(browser, "work-lines")
        assert "rarms start, which shows" in waits_for(
            browser, "return document.querySelector('#apply .does')?.textContent"
        )
        types(browser, "apply-application", "slow")
        # The hosts first: the preview has ended as `rarms start`, too, and while an action runs no other begins.
        waits_for(browser, "return !document.getElementById('hosts').textContent.includes('test partition')")
        assert waits_for_end(browser, "rarms start") == "ended."
        press(browser, "measure")
        waits_for(browser, "return document.querySelector('#m1 .dot') !== null")


def test_deleted_cookies_do_not_mean_server_gone(browser: "WebDriver", tmp_path: Path) -> None:
    rarms(tmp_path, "init")
    with studio(tmp_path) as served:
        opens(browser, served)
        browser.delete_all_cookies()
        with (tmp_path / "rarms.yaml").open("a", encoding="utf-8") as manifest:
            manifest.write("# later\n")
        waits_for(browser, "return !document.getElementById('connection').hidden")
        assert browser.find_element("id", "connection").text.startswith("The studio no longer accepts this browser")
        assert served.closes() == 0
        waits_for(
            browser, "return document.getElementById('connection').innerText.startsWith('The server is not running. ')"
        )
    assert any("403" in text for text in messages_of_errors(browser))


class Foreign(BaseHTTPRequestHandler):
    """A page of another user of this machine, or of the internet."""

    cookies: list[str]

    def do_GET(self) -> None:
        self.cookies.append(self.headers.get("Cookie", ""))
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(b"<!doctype html><title>foreign</title>")

    def log_message(self, *_words: object) -> None:
        pass


ATTEMPTS = """
    const [page, done] = arguments;
    const refused = "refused", credentials = "include";
    const post = (mode, type) =>
      fetch(`${page}do/measure`, { method: "POST", mode, credentials, headers: { "Content-Type": type }, body: "{}" })
        .then((answer) => answer.status, () => refused);
    const loaded = (name, values, found) => new Promise((resolve) => {
      const element = Object.assign(document.createElement(name), values);
      element.addEventListener("load", () => resolve(found(element)));
      element.addEventListener("error", () => resolve(refused));
      document.body.append(element);
    });
    (async () => done({
      "post": await post("cors", "application/json"),
      "simple post": await post("no-cors", "text/plain"),
      "read": await fetch(page, { credentials }).then((answer) => answer.status, () => refused),
      "frame": await loaded("iframe", { src: page }, (frame) => frame.contentDocument?.title ?? refused),
      "script": await loaded("script", { type: "module", src: `${page}modules/studio.js` }, () => "ran"),
    }))();
"""
"""What a page of another origin may try; each answer that it could read, or `refused`."""


def test_a_foreign_origin_gets_and_changes_nothing(browser: "WebDriver", shared: Studio) -> None:
    seen: list[str] = []
    server = ThreadingHTTPServer(("127.0.0.1", 0), type("Handler", (Foreign,), {"cookies": seen}))
    Thread(target=server.serve_forever, daemon=True).start()
    try:
        opens(browser, shared)
        before = shown(browser, "hosts"), shown(browser, "work")
        browser.get(f"http://127.0.0.1:{server.server_port}/{shared.page.rsplit('/', 2)[1]}x/")
        tried = browser.execute_async_script(ATTEMPTS, shared.page)
        assert tried == dict.fromkeys(("post", "simple post", "read", "frame", "script"), "refused")
        assert {"rarms-studio" in cookie for cookie in seen} == {False}, "the cookie is bound to a path"
        browser.get(shared.page)
        waits_for(browser, ALIVE)
        assert (shown(browser, "hosts"), shown(browser, "work")) == before
    finally:
        server.shutdown()
        server.server_close()


def test_page_passes_accessibility_rules(browser: "WebDriver", shared: Studio) -> None:
    require("axe")
    axe = files("axe_core_python").joinpath("axe.min.js").read_text(encoding="utf-8")
    opens(browser, shared)
    press(browser, "plan")
    waits_for(browser, "return document.getElementById('the-plan') !== null")
    browser.find_element("css selector", "[data-preview=m1]").click()
    waits_for(browser, "return document.querySelector('#m1 .edit:not([hidden])')")
    for width, dark in ((1200, False), (1200, True), (600, False), (360, True)):  # 600: a screen of 1200 at 200 %
        looks(browser, width=width, dark=dark)
        keeps(browser, f"{width}-{'dark' if dark else 'light'}", width)
        assert browser.execute_script("return document.documentElement.scrollWidth") <= width
        assert browser.execute_script(LEAST_CONTRAST) >= 4.5
        browser.execute_script(f"if (!window.axe) {{ {axe} }}")
        found = browser.execute_async_script("axe.run().then((results) => arguments[0](results.violations))")
        serious = [
            (each["id"], [node["html"][:120] for node in each["nodes"]])
            for each in found
            if each["impact"] in {"serious", "critical"}
        ]
        assert serious == []


def test_level_that_no_reserve_achieves_leaves_headroom_unknown(browser: "WebDriver", tmp_path: Path) -> None:
    rarms(tmp_path, "init")
    manifest = tmp_path / "rarms.yaml"
    one_load = re.sub(r"interference: \[.*?\]", "interference: [busy-loop]", manifest.read_text(encoding="utf-8"))
    manifest.write_text(one_load, encoding="utf-8", newline="\n")  # of one load several settings are measured
    rarms(tmp_path, "measure", "control")
    with studio(tmp_path) as served:
        opens(browser, served)
        before = waits_for(browser, "return document.querySelector('#fit-1 .sentence')?.textContent")
        assert before.startswith("1 LP of 2 LP reserved"), "the manifest fixes 0.6 LP and 0.4 LP"
        assert (
            "The bars show the current position of the lines."
            in browser.find_element("css selector", "[data-key=summary]").text
        )
        browser.find_element("id", "m1-1-line").send_keys("\ue011")  # Home
        assert shown(browser, "m1-reserve") == "Not achieved"
        browser.execute_async_script("requestAnimationFrame(() => setTimeout(arguments[0]))")
        sentence = browser.find_element("css selector", "#fit-1 .sentence").text
        assert sentence.startswith("At least 1 LP of 2 LP reserved")
        assert sentence.endswith("Headroom of onboard: not known: control is not achieved.")
        assert shown(browser, "m1-headroom") == "Headroom of onboard: not known: control is not achieved."
        assert shown(browser, "m1-level").endswith("To follow the level, set cpu: { reserve: measured }.")
        assert "cpu" not in shown(browser, "m1-manifest"), "the edit is the level alone, as the button shows it"
        hidden = "return document.querySelectorAll('#m1-1-reserves > text[visibility=hidden]').length"
        assert browser.execute_script(hidden) == 0, "a mark that is not shown covers no label"


def test_bar_counts_line_despite_fixed_reserve(browser: "WebDriver", shared: Studio) -> None:
    remark = (
        " This counts control by the lines. The manifest fixes a different reserve. To follow the lines, set "
        "cpu: { reserve: measured }."
    )
    opens(browser, shared)
    waits_for(browser, "return document.querySelector('#fit-1 .sentence')?.textContent")
    browser.find_element("id", "m1-1-line").send_keys("\ue013")  # up
    assert shown(browser, "m1-reserve").endswith("LP")
    assert browser.find_element("css selector", "#fit-1 .sentence").text.endswith(remark)
    browser.find_element("id", "m1-reset").click()
    assert remark not in browser.find_element("css selector", "#fit-1 .sentence").text


def test_commands_name_manifest_that_studio_was_started_with(browser: "WebDriver", tmp_path: Path) -> None:
    cell = tmp_path / "cell"
    cell.mkdir()
    (cell / "rarms.yaml").write_text(TIGHT, encoding="utf-8", newline="\n")
    rarms(tmp_path, "measure", "-f", "cell")
    rarms(tmp_path, "measure", "-f", "cell", "--from", "20%", "--to", "100%")
    with studio(tmp_path, "-f", "cell") as served:
        opens(browser, served)
        waits_for(browser, "return document.getElementById('findings') !== null")
        commands = "return [...document.querySelectorAll(arguments[0])].map((each) => each.textContent)"
        assert shown(browser, "m1-command") == 'rarms select vision --at "24 ms" -f cell'
        found = browser.execute_script(commands, "[aria-labelledby=findings] code, [data-way]:not(#next button)")
        assert found
        assert {words.endswith(" -f cell") for words in found if words.startswith("rarms ")} == {True}
        browser.find_element("css selector", "[data-levels]").click()
        follows = waits_for(
            browser, "return document.querySelector('details .edit:not([hidden]) .follows')?.textContent"
        )
        assert re.match(r'rarms select \w+ --at "[\d.]+ ms" -f cell\n', follows)
        assert "Headroom of onboard: " in follows, "all its levels together fit"


def test_plan_of_changed_manifest_shows_no_command(browser: "WebDriver", tmp_path: Path) -> None:
    rarms(tmp_path, "init")
    manifest = tmp_path / "rarms.yaml"
    with studio(tmp_path) as served:
        opens(browser, served)
        press(browser, "plan")
        waits_for(browser, "return document.querySelector('#apply .does') !== null")
        with manifest.open("a", encoding="utf-8") as file:
            file.write("# another hand\n")
        waits_for(browser, "return document.querySelector('#apply .does') === null")
        assert "has changed since plan" in browser.find_element("id", "the-plan").text
        assert browser.find_element("css selector", "#apply button").is_displayed()


def test_long_words_break_lines_and_not_the_page(browser: "WebDriver", tmp_path: Path) -> None:
    name = "c" * 63
    text = TIGHT.replace("{ name: tight }", f"{{ name: tight, description: {'W' * 200} }}").replace("vision", name)
    (tmp_path / "rarms.yaml").write_text(text, encoding="utf-8", newline="\n")
    with studio(tmp_path) as served:
        opens(browser, served)
        assert "W" * 200 in browser.find_element("tag name", "header").text.replace("\n", "")
        for width in (1200, 600, 360):
            looks(browser, width=width)
            assert browser.execute_script("return document.documentElement.scrollWidth") <= width


def test_each_way_out_shows_its_edit(browser: "WebDriver", tmp_path: Path) -> None:
    (tmp_path / "rarms.yaml").write_text(TIGHT, encoding="utf-8", newline="\n")
    rarms(tmp_path, "measure")
    rarms(tmp_path, "measure", "--from", "20%", "--to", "100%")
    with studio(tmp_path) as served:
        opens(browser, served)
        waits_for(browser, "return document.getElementById('findings') !== null")
        finding = browser.find_element("css selector", "section[aria-labelledby=findings] details[open]")
        finding.find_element("css selector", WAY.format("talk")).click()
        difference = waits_for(
            browser, "return document.querySelector('details .edit:not([hidden]) .difference')?.textContent"
        )
        assert "-    apt: { mean_response_time: { at_most: 30 ms } }" in difference
        keeps(browser, "ways-out")
        finding.find_element("css selector", "[data-way=tune]").click()
        assert browser.execute_script("return document.activeElement.closest('form')?.id") == "tune"

        press(browser, "tune")
        assert waits_for_end(browser, "rarms tune") == "ended with problems.", "no combination is enough here"
        assert "onboard" in shown(browser, "work-lines")

        way = waits_for(browser, "return document.querySelector(arguments[0])", WAY.format("talk"))
        levels = json.loads(way.get_attribute("data-levels"))
        way.click()
        waits_for(browser, "return document.querySelector('details .edit:not([hidden]) .write:not([hidden])')").click()
        for level in levels:
            waits_for(browser, WRITTEN, level["component"], level["level"])
        waits_for(browser, "return !document.querySelector('[data-levels]')")
        keeps(browser, "fits")
    assert rarms(tmp_path, "plan")


def test_open_and_focused_parts_stay(browser: "WebDriver", tmp_path: Path) -> None:
    (tmp_path / "rarms.yaml").write_text(TIGHT, encoding="utf-8", newline="\n")
    rarms(tmp_path, "measure", "speech")
    with studio(tmp_path) as served:
        opens(browser, served)
        details = browser.find_element("css selector", "#m1 details")
        details.find_element("tag name", "summary").click()
        browser.find_element("id", "m1-1-line").send_keys("\ue013")  # arrow up
        browser.find_element("css selector", "[data-preview=m1]").click()
        write = waits_for(browser, "return document.querySelector('#m1 .edit:not([hidden]) .write:not([hidden])')")
        difference = browser.find_element("css selector", "#m1 .difference").text
        browser.execute_script("arguments[0].focus()", write)
        browser.find_element("id", "measure-first").send_keys("20")
        browser.execute_script("arguments[0].focus()", write)

        rarms(tmp_path, "measure", "vision")
        waits_for(browser, "return document.getElementById('m2-name')?.textContent === 'speech'")
        assert browser.find_element("id", "m1-name").text == "vision", "a curve that came stands before it"
        assert browser.execute_script("return document.activeElement === arguments[0]", write)
        assert write.is_displayed()
        assert browser.find_element("css selector", "#m2 .difference").text == difference
        assert details.get_attribute("open") is not None
        assert browser.find_element("id", "measure-first").get_attribute("value") == "20"
        browser.find_element("id", "m2-1-line").send_keys("\ue013")
        assert not write.is_displayed(), "what was shown is not what would be written now"
    assert messages_of_errors(browser) == []


WAY = """[data-levels*='"{}"']"""
WRITTEN = """
    const rows = [...document.querySelectorAll("#components tbody tr")];
    return rows.find((row) => row.firstElementChild.textContent === arguments[0]).textContent.includes(arguments[1]);
"""


def test_read_only_shows_everything_and_changes_nothing(browser: "WebDriver", robot: Path) -> None:
    before = {path: path.read_bytes() for path in robot.rglob("*") if path.is_file()}
    with studio(robot, "--read-only") as served:
        opens(browser, served)
        disabled = "return [...document.querySelectorAll(arguments[0])].map((each) => each.disabled)"
        assert set(browser.execute_script(disabled, "#measure button, #prove button, [data-measure], .write")) == {True}
        press(browser, "plan")
        waits_for(browser, "return document.getElementById('the-plan') !== null")
        assert browser.execute_script(disabled, "#apply button") == [True]
    assert {path: path.read_bytes() for path in robot.rglob("*") if path.is_file()} == before
