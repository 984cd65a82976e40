"""A real Chromium without a window, reached over WebDriver: for tests of pages."""

import base64
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from selenium.webdriver.chrome.webdriver import WebDriver

FLAGS = (
    "--headless=new",
    "--no-sandbox",  # root's Chromium starts no other way
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
)

ANSWERED_S = 600
"""The driver answers within this time. Longer than any script waits: otherwise a wait ends without its own message."""


@contextmanager
def chromium(profile: Path, *flags: str) -> Iterator["WebDriver"]:
    """The machine's own Chromium with a fresh profile, and these flags; it is ended after an error, too."""
    from selenium.webdriver import Chrome, ChromeOptions
    from selenium.webdriver.chrome.service import Service

    options = ChromeOptions()
    options.binary_location = shutil.which("chromium") or ""
    for flag in (*FLAGS, *flags, f"--user-data-dir={profile}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = Chrome(options=options, service=Service(shutil.which("chromedriver") or ""))
    assert not isinstance(driver.command_executor, str), "the driver has a connection"
    driver.command_executor.client_config.timeout = ANSWERED_S
    try:
        yield driver
    finally:
        driver.quit()


def ask(driver: "WebDriver", command: str, **values: Any) -> Any:
    """A command of the browser's own protocol (CDP)."""
    return driver.execute_cdp_cmd(command, values)


def looks(driver: "WebDriver", *, width: int, height: int = 900, dark: bool = False) -> None:
    """A screen so wide, of a person who prefers light or dark."""
    scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
    ask(driver, "Emulation.setEmulatedMedia", features=[scheme])
    ask(
        driver,
        "Emulation.setDeviceMetricsOverride",
        width=width,
        height=height,
        deviceScaleFactor=1,
        mobile=width < 500,
    )


def whole_page(driver: "WebDriver", width: int) -> bytes:
    """A picture of all of the page, as PNG."""
    height = driver.execute_script("return document.documentElement.scrollHeight")
    clip = {"x": 0, "y": 0, "width": width, "height": height, "scale": 1}
    return base64.b64decode(ask(driver, "Page.captureScreenshot", captureBeyondViewport=True, clip=clip)["data"])


def messages(driver: "WebDriver", log: str) -> list[str]:
    """What the browser logged since it was last asked: `browser` for the page's own, `performance` for requests."""
    entries = driver.get_log(log)  # type: ignore[no-untyped-call]  # selenium says no types here
    return [str(entry["message"]) for entry in entries]
