"""The report in a real browser: its lines are dragged, and what it says is what the planner takes.

RARMS_PICTURES=FOLDER keeps pictures of the page, to be looked at.
"""

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import yaml

from rarms_iac.app.data_logs import curves_in
from rarms_iac.app.drift import ComparedHost
from rarms_iac.app.report_model import PlatformTuning
from rarms_iac.diff.drift import DriftKind, ResourceDrift
from rarms_iac.model.changes import Address
from rarms_iac.model.quantities import Unit, parse_quantity
from rarms_iac.model.seen_host import unseen
from rarms_iac.model.system import AtLeast, AtMost, Threshold
from rarms_iac.planner.verdicts import MeasuredTogether, decide
from rarms_iac.statistics.curves import curve_of, least_reserve
from rarms_iac.views.reports.html import as_html
from tests.browser import ask, chromium, looks, messages, whole_page
from tests.builders_measured import TUNED
from tests.robots import a_robot, report_of_logs, the_logs
from tests.unit.views.reports.test_html import all_of

if TYPE_CHECKING:
    from selenium.webdriver.chrome.webdriver import WebDriver
    from selenium.webdriver.remote.webelement import WebElement

pytestmark = pytest.mark.needs("chromium")

SYSTEM = a_robot()
LOGS = {log.log.header.setup.members[0]: log.log for log in the_logs(SYSTEM)}
FACES, SUCCESS, P95, PATHS = "m1-1", "m2-1", "m2-2", "m3-1"


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator["WebDriver"]:
    folder = tmp_path_factory.mktemp("report")
    difference = ResourceDrift(address=Address(partition="vision"), drift=DriftKind.REMOVED, message="gone")
    (host,) = SYSTEM.hosts.values()
    report = replace(
        report_of_logs(SYSTEM, the_logs(SYSTEM)),
        hosts=(ComparedHost(seen=unseen(host, "robot"), drifted=(difference,)),),
        tunings=(PlatformTuning(platform="onboard", run=TUNED),),
        candidates=all_of(("path-planning", "speech-recognition", "video-streaming", "vision")),
    )
    (folder / "report.html").write_bytes(as_html(report))
    with chromium(folder / "profile") as driver:
        driver.get((folder / "report.html").as_uri())
        yield driver


@pytest.fixture
def page(browser: "WebDriver") -> "WebDriver":
    """The page as it is when it is opened."""
    looks(browser, width=1200)
    browser.refresh()
    return browser


def run(page: "WebDriver", script: str, *values: object) -> Any:
    return page.execute_script(script, *values)


def line(page: "WebDriver", plot: str) -> "WebElement":
    return page.find_element("id", f"{plot}-line")


def text(page: "WebDriver", name: str) -> str:
    return str(run(page, "return document.getElementById(arguments[0]).textContent", name))


def pasted(page: "WebDriver", card: str) -> Mapping[str, Mapping[str, Threshold]]:
    """The thresholds in the lines to paste, read as the manifest's reader would."""
    lines = yaml.safe_load(text(page, f"{card}-manifest"))
    return {
        name: {index: threshold(words) for index, words in line["apt"].items()}
        for name, line in lines["components"].items()
    }


def threshold(words: Mapping[str, str]) -> Threshold:
    [(side, quantity)] = words.items()
    value = parse_quantity(quantity, Unit.TIME, Unit.SHARE, Unit.RATE)[1]
    return AtMost(value=value) if side == "at_most" else AtLeast(value=value)


def planned(apts: Mapping[str, Mapping[str, Threshold]]) -> int | None:
    """What the planner would reserve for these."""
    pairs = []
    for name, apt in apts.items():
        how = SYSTEM.components[name].run
        assert how is not None
        pairs += [(curve_of(LOGS[name].settings, name, index, how), wanted) for index, wanted in apt.items()]
    found = least_reserve(pairs)
    return None if found is None else found


def message(page: "WebDriver", card: str) -> int | None:
    """The reserve that the page shows, in per cent of the component's two processors."""
    shown = text(page, f"{card}-reserve")
    return (
        None
        if shown.startswith(("Not ", "Inconclusive"))
        else round(50 * float(shown.removeprefix("Reserve ").removesuffix(" LP")))
    )


def test_line_dragged_by_mouse_reserves_what_planner_would(page: "WebDriver") -> None:
    from selenium.webdriver import ActionChains

    seen = set()
    for card, plot in (("m1", FACES), ("m2", SUCCESS), ("m2", P95), ("m3", PATHS)):
        height = in_view(page, f"{plot}-field")
        ActionChains(page, duration=0).click_and_hold(line(page, plot)).move_by_offset(0, -height).perform()
        for _ in range(9):
            ActionChains(page, duration=0).move_by_offset(0, height // 7).perform()
            a_frame_later(page)
            seen.add((card, text(page, f"{plot}-value"), message(page, card)))
            assert message(page, card) == planned(pasted(page, card))
        ActionChains(page, duration=0).release().move_by_offset(0, -50).perform()
        assert (card, text(page, f"{plot}-value"), message(page, card)) in seen, "let go of, a line stays"
        page.find_element("id", f"{card}-reset").click()
    assert len(seen) > 20
    assert len({reserve for _, _, reserve in seen}) > 8


def a_frame_later(page: "WebDriver") -> None:
    """Chromium hands moves of a pointer over once a frame."""
    page.execute_async_script("requestAnimationFrame(() => setTimeout(arguments[0]))")


def in_view(page: "WebDriver", name: str) -> int:
    """Scrolls there; the height of what is there."""
    find = "const one = document.getElementById(arguments[0]); one.scrollIntoView({block: 'center'});"
    return int(run(page, find + "return one.getBoundingClientRect().height", name))


@pytest.mark.sample
def test_keyboard_moves_a_line_and_says_so(page: "WebDriver") -> None:
    from selenium.webdriver import Keys

    slider = line(page, FACES)
    assert (slider.aria_role, slider.get_attribute("aria-valuenow")) == ("slider", "100")
    thresholds = []
    for key in (Keys.ARROW_DOWN, Keys.ARROW_LEFT, Keys.PAGE_DOWN, Keys.ARROW_UP, Keys.ARROW_RIGHT, Keys.PAGE_UP):
        slider.send_keys(key)
        thresholds.append(Fraction(slider.get_attribute("aria-valuenow") or ""))
    step = 100 - thresholds[0]

    assert [(threshold - 100) / step for threshold in thresholds] == [-1, -2, -12, -11, -10, 0]
    slider.send_keys(Keys.HOME)
    assert text(page, "m1-reserve") == "Not achieved"
    assert "not achieved" in (slider.get_attribute("aria-valuetext") or "")
    slider.send_keys(Keys.END)
    assert message(page, "m1") == 10
    assert "needs 0.2 LP (10 % of its 2 VPs)" in (slider.get_attribute("aria-valuetext") or "")
    slider.send_keys(*[Keys.PAGE_DOWN] * 40)
    for _ in range(12):
        slider.send_keys(*[Keys.ARROW_DOWN] * 7)
        assert message(page, "m1") == planned(pasted(page, "m1"))


def test_every_step_of_every_line_agrees_with_planner(page: "WebDriver") -> None:
    """The same keys as a person's, pressed by a script, all the way: what was looked up cannot be luck."""
    walk = """
        const [plot, card] = arguments, found = [], line = document.getElementById(`${plot}-line`);
        const press = (key) => line.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true }));
        press("Home");
        for (let last = null; last !== line.getAttribute("aria-valuenow"); press("ArrowUp")) {
          last = line.getAttribute("aria-valuenow");
          found.push([last, document.getElementById(`${card}-reserve`).textContent]);
        }
        return found;
    """
    name = "face-detection"
    log = MeasuredTogether(
        path="",
        interference="busy-loop",
        processors=2,
        measured=tuple(sorted(setting.reserve for setting in LOGS[name].settings)),
        curves=curves_in(LOGS[name], SYSTEM.components),
        records=LOGS[name],
    )

    found = run(page, walk, FACES, "m1")

    assert len(found) > 500
    for value, shown in found:
        faces = replace(SYSTEM.components[name], apt={"mean_response_time": AtMost(value=Fraction(value))})
        verdict = decide([faces], [log]).verdict
        wanted = verdict.achievement.capitalize() if verdict.reserve is None else f"Reserve {verdict.reserve / 50:g} LP"
        assert shown == wanted, value
    assert {"Inconclusive", "Not achieved"} < {shown for _, shown in found}


def test_a_line_follows_a_finger(page: "WebDriver") -> None:
    looks(page, width=360)
    ask(page, "Emulation.setTouchEmulationEnabled", enabled=True)
    in_view(page, f"{FACES}-field")
    box = run(page, "return document.getElementById(arguments[0]).getBoundingClientRect().toJSON()", f"{FACES}-line")
    point = {"x": box["x"] + 100, "y": box["y"] + box["height"] / 2}

    ask(page, "Input.dispatchTouchEvent", type="touchStart", touchPoints=[point])
    for lower in (10, 25, 40, 55):
        ask(page, "Input.dispatchTouchEvent", type="touchMove", touchPoints=[{**point, "y": point["y"] - lower}])
    ask(page, "Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    a_frame_later(page)
    ask(page, "Emulation.setTouchEmulationEnabled", enabled=False)

    assert 10 < (message(page, "m1") or 0) < 60
    assert message(page, "m1") == planned(pasted(page, "m1"))


def test_headroom_follows_lines_and_reset_brings_them_back(page: "WebDriver") -> None:
    from selenium.webdriver import Keys

    assert "Headroom of onboard: 0.28 LP (14 % of onboard)" in text(page, "fit-1")
    line(page, FACES).send_keys(Keys.END)
    assert text(page, "m1-headroom") == "Headroom of onboard: 1.28 LP (64 % of onboard)."
    line(page, SUCCESS).send_keys(Keys.END)
    reset = page.find_element("id", "m1-reset")
    reset.click()
    page.find_element("id", "m2-reset").click()

    assert "Headroom of onboard: 0.28 LP (14 % of onboard)" in text(page, "fit-1")
    assert (message(page, "m1"), message(page, "m2"), reset.is_displayed()) == (60, 16, False)


def test_lines_to_paste_are_copied(page: "WebDriver") -> None:
    from selenium.webdriver import Keys

    line(page, FACES).send_keys(Keys.PAGE_UP)
    value = line(page, FACES).get_attribute("aria-valuenow")
    ask(page, "Browser.grantPermissions", permissions=["clipboardReadWrite", "clipboardSanitizedWrite"])

    page.find_element("css selector", '[data-copy="m1-command"]').click()
    copied = page.execute_async_script("navigator.clipboard.readText().then(arguments[0])")

    assert copied == f'rarms select face-detection --at "{value} ms"'
    assert text(page, "m1-manifest").splitlines()[-1] == f"      mean_response_time: {{ at_most: {value} ms }}"


def test_nothing_is_fetched_and_foreign_code_blocked(page: "WebDriver") -> None:
    assert run(page, "return performance.getEntriesByType('resource').length") == 0
    asked = [json.loads(message)["message"] for message in messages(page, "performance")]
    requests = [event["params"] for event in asked if event["method"] == "Network.requestWillBeSent"]
    assert {request["request"]["url"] for request in requests if request["documentURL"] == page.current_url} == {
        page.current_url
    }
    assert messages(page, "browser") == []

    run(
        page,
        "const foreign = document.createElement('div');"
        'foreign.innerHTML = \'<img src="data:," onerror="window.foreign = 1">\';'
        "document.body.append(foreign);"
        "const script = document.createElement('script'); script.textContent = 'window.foreign = 1';"
        "document.body.append(script);",
    )

    assert run(page, "return window.foreign ?? null") is None
    assert any("Content Security Policy" in message for message in messages(page, "browser"))


@pytest.mark.parametrize(("width", "dark"), [(1200, False), (1200, True), (700, True), (360, False)])
def test_page_fits_screens_and_is_readable(page: "WebDriver", width: int, dark: bool) -> None:
    looks(page, width=width, dark=dark)

    assert run(page, "return document.documentElement.scrollWidth") <= width
    a_frame_later(page)
    assert run(page, PILLS_OVER_TEXT) == []
    assert run(page, LEAST_CONTRAST) >= 4.5
    if folder := os.environ.get("RARMS_PICTURES"):
        Path(folder, f"report-{width}-{'dark' if dark else 'light'}.png").write_bytes(whole_page(page, width))


PILLS_OVER_TEXT = """
    const boxes = (query) => [...document.querySelectorAll(query)]
      .filter((one) => getComputedStyle(one).visibility === "visible")
      .map((one) => [one.textContent, one.getBoundingClientRect()]);
    const meet = (a, b) => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
    const labels = boxes(".values > text, .reserves > text");
    const over = (pill) => labels.filter(([, box]) => meet(pill, box)).map(([text]) => text);
    return boxes(".pill, .mark rect").flatMap(([, pill]) => over(pill));
"""

CONTRAST = """
    const channel = (value) => (value / 255 <= 0.04045 ? value / 255 / 12.92 : ((value / 255 + 0.055) / 1.055) ** 2.4);
    const parts = (colour) => colour.match(/[0-9.]+/g).map(Number);
    const light = ([red, green, blue]) => 0.2126 * channel(red) + 0.7152 * channel(green) + 0.0722 * channel(blue);
    const contrast = (one, other) => {
      const [more, less] = [light(one), light(other)].sort((a, b) => b - a);
      return (more + 0.05) / (less + 0.05);
    };
    const behind = (one) => {
      for (let at = one; at !== null; at = at.parentElement) {
        const colour = parts(getComputedStyle(at).backgroundColor);
        if (colour.length === 3 || colour[3] === 1) return colour;
      }
    };
"""

LEAST_CONTRAST = (
    CONTRAST
    + """
    return Math.min(...[...document.querySelectorAll("h1, h2, p, th, td, dd, dt, pre, button, summary, .pill")]
      .filter((one) => one.offsetParent !== null && one.textContent.trim() !== "")
      .map((one) => contrast(parts(getComputedStyle(one).color), behind(one))));
"""
)
