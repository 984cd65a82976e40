"""How quick the studio's page is with 100 components of 10,000 samples each: first paint, and tasks while dragging.

`python -m benchmarks.studio [COMPONENTS]`. Needs Chromium. The longest task is that of Chromium's own trace.
"""

import json
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from queue import Queue
from threading import Thread
from typing import TYPE_CHECKING

from benchmarks.timing import Figure, report
from rarms_iac.app.report_measurements import ReportedLog
from rarms_iac.app.requests import ManifestSource
from rarms_iac.model.setting import Setting
from rarms_iac.model.system import Component
from rarms_iac.studio.knowledge import Knowledge, Watch
from rarms_iac.studio.page import StudioSettings
from rarms_iac.studio.server import serve
from tests.browser import chromium, looks
from tests.builders import a_component, a_host, a_run, a_system, at_most
from tests.builders_measured import a_log, a_subject
from tests.robots import RESERVES, a_measured_setting, path_planning, report_of_logs
from tests.unit.studio.studio_client import Closing

if TYPE_CHECKING:
    from selenium.webdriver.chrome.webdriver import WebDriver

COMPONENTS = 100
SAMPLES = 10_000
PAINT_GOAL_MS = 300.0
TASK_GOAL_MS = 100.0
TASK = "ThreadControllerImpl::RunTask"
TRACE = ("--trace-startup=toplevel,blink.user_timing", "--trace-startup-duration=0", "--trace-startup-format=json")
MOVES = 60


class Prepared(Watch):
    """What is known, without files."""

    def __init__(self, source: ManifestSource, known: Knowledge) -> None:
        super().__init__(source)
        self._prepared = known

    def knowledge(self) -> Knowledge:
        return self._prepared


def known(count: int) -> Knowledge:
    """Components with ten settings each, all of one shape."""
    components = [
        a_component(f"c{number}", reserve="measured", run=a_run(), apt={"mean_response_time": at_most(100)})
        for number in range(count)
    ]
    system = a_system(hosts=[a_host("onboard", platform="onboard")], components=components)
    settings = [
        a_measured_setting("c", reserve, path_planning, samples=SAMPLES // len(RESERVES)) for reserve in RESERVES
    ]
    logs = [_log_of(component, settings) for component in components]
    return Knowledge(version="", report=report_of_logs(system, logs))


def _log_of(component: Component, settings: Sequence[Setting]) -> ReportedLog:
    own = [
        replace(setting, series=tuple(replace(series, component=component.name) for series in setting.series))
        for setting in settings
    ]
    path = f"measurements/onboard/{component.name}/busy-loop.jsonl"
    return ReportedLog(path=path, log=a_log(own, a_subject(component)))


def tasks_while_dragging(trace: Path) -> Sequence[float]:
    """Milliseconds of each task of the page's own thread between the marks that the page set."""
    events = json.loads(trace.read_text(encoding="utf-8"))["traceEvents"]
    begin, end = (next(event for event in events if event["name"] == f"drag-{name}") for name in ("begin", "end"))
    return [
        event["dur"] / 1000
        for event in events
        if event["name"] == TASK
        and "dur" in event
        and (event["pid"], event["tid"]) == (begin["pid"], begin["tid"])
        and begin["ts"] <= event["ts"] <= end["ts"]
    ]


def drag(driver: "WebDriver") -> None:
    """Up and down, as a hand does, some sixty steps of a frame."""
    from selenium.webdriver import ActionChains

    line = driver.find_element("id", "m1-1-line")
    driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", line)
    time.sleep(1)
    ActionChains(driver, duration=0).click_and_hold(line).perform()
    driver.execute_script("performance.mark('drag-begin')")
    moves = ActionChains(driver, duration=16)
    for number in range(MOVES):
        moves.move_by_offset(0, 3 if number % 20 < 10 else -3)
    moves.perform()
    driver.execute_script("performance.mark('drag-end')")
    ActionChains(driver, duration=0).release().perform()


PAINTED = """
    const answered = performance.getEntriesByType("navigation")[0].responseStart;
    return performance.getEntriesByName("first-contentful-paint")[0].startTime - answered;
"""


def measure(count: int) -> Iterator[Figure]:
    addresses: Queue[str] = Queue()
    closing = Closing()
    with tempfile.TemporaryDirectory() as folder:
        source, trace = ManifestSource(manifest=folder), Path(folder) / "trace.json"
        settings = StudioSettings(source=source)
        thread = Thread(target=serve, args=(settings, closing, addresses.put, Prepared(source, known(count))))
        thread.start()
        try:
            with chromium(Path(folder) / "profile", *TRACE, f"--trace-startup-file={trace}") as driver:
                looks(driver, width=1200)
                driver.get(addresses.get())
                time.sleep(3)
                driver.refresh()
                time.sleep(3)
                paint = float(driver.execute_script(PAINTED))
                drag(driver)
            tasks = tasks_while_dragging(trace)
        finally:
            closing.asked.set()
            thread.join()
    yield Figure(name="first paint after the server answers", value=paint, unit="ms", at_most=PAINT_GOAL_MS)
    name = f"longest of {len(tasks)} tasks while a line is dragged, {count} components"
    yield Figure(name=name, value=max(tasks), unit="ms", at_most=TASK_GOAL_MS)


if __name__ == "__main__":
    sys.exit(report(list(measure(int(sys.argv[1]) if len(sys.argv) > 1 else COMPONENTS))))
