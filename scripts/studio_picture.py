"""The picture of the studio for README.md and docs/studio.md: the delivery robot, measured, with a line being dragged.

`python -m scripts.studio_picture` writes `docs/figures/studio.png`. Needs Chromium and selenium.
"""

import base64
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.browser import ask, chromium, looks

FIGURE = Path("docs/figures/studio.png").resolve()
WIDTH, HEIGHT = 1100, 860
RARMS = (sys.executable, "-m", "rarms_iac.cli.main")


def main() -> int:
    from selenium.webdriver import Keys

    with tempfile.TemporaryDirectory() as folder:
        robot = Path(folder) / "robot"
        shutil.copytree("manifests/delivery-robot", robot, ignore=shutil.ignore_patterns(".rarms"))
        environment = {**os.environ, "PYTHONPATH": str(Path.cwd())}
        subprocess.run([*RARMS, "measure"], cwd=robot, env=environment, check=False, stdout=subprocess.DEVNULL)
        words = [*RARMS, "studio", "--no-open"]
        served = subprocess.Popen(words, cwd=robot, env=environment, stdout=subprocess.PIPE, text=True)
        assert served.stdout is not None
        try:
            with chromium(Path(folder) / "profile") as driver:
                looks(driver, width=WIDTH, height=HEIGHT)
                driver.get(served.stdout.readline().strip())
                time.sleep(3)
                line = driver.find_element("id", "m1-1-line")
                line.send_keys(*[Keys.PAGE_UP] * 4)
                driver.find_element("css selector", "[data-preview=m1]").click()
                time.sleep(2)
                driver.execute_script("document.getElementById('m1').scrollIntoView({block: 'start'})")
                driver.execute_script("scrollBy(0, -140)")
                time.sleep(1)
                FIGURE.write_bytes(base64.b64decode(ask(driver, "Page.captureScreenshot")["data"]))
        finally:
            served.terminate()
            served.wait()
    print(f"Wrote {FIGURE}.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
