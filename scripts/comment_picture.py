"""The picture of a pull request's comment for docs/pull-requests.md: `rarms plan` writes it, Chromium draws it.

`python -m scripts.comment_picture` writes `docs/figures/pull-request.png`.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

from markdown_it import MarkdownIt

FIGURES = Path("docs/figures").resolve()
WIDTH, HEIGHT = 860, 560

BASE = """schema: rarms/v1

application:
  name: delivery-robot

hosts:
  onboard: { logical_processors: 4, memory: 8 GiB, keep_for_host: { processor: 10 %, memory: 1 GiB } }

components:
  vision:
    criticality: 40
    apt: { mean_response_time: { at_most: 100 ms } }
    memory: 1 GiB
    processors: 2
    simulation: { work: 61.6 ms, blocked: 26.4 ms, varies: 5 % }

  speech:
    criticality: 30
    apt: { p95_response_time: { at_most: 400 ms } }
    memory: 1 GiB
    processors: 2
    simulation: { work: 50 ms, varies: 10 % }

  planning:
    criticality: 20
    memory: 2 GiB
    cpu: { reserve: 20 % }

partitions:
  planning: { stop: { grace: 45 s } }
"""
HEAD = BASE.replace("at_most: 100 ms", "at_most: 110 ms").replace(
    "memory: 2 GiB\n    cpu: { reserve: 20 % }", "memory: 1 GiB\n    processors: 2\n    cpu: { reserve: 15 % }"
)

STYLE = """
body { margin: 24px; font: 15px/1.5 "DejaVu Sans", sans-serif; color: #1f2328; }
main { border: 1px solid #d0d7de; border-radius: 6px; padding: 6px 22px; }
h3 { font-size: 20px; margin: 12px 0; } h4 { font-size: 16px; margin: 14px 0 6px; }
ul { padding-left: 22px; margin: 6px 0; } summary { cursor: pointer; margin: 8px 0; }
table { border-collapse: collapse; } td, th { border: 1px solid #d0d7de; padding: 4px 10px; }
code { background: #eff1f3; border-radius: 4px; padding: 1px 5px; font-size: 13px; }
"""


def write_comment(folder: Path) -> str:
    """Apply the base in this folder, change the manifest, and return the comment."""
    manifest = folder / "cell" / "rarms.yaml"
    manifest.parent.mkdir()
    manifest.write_text(BASE, encoding="utf-8")
    for words in ("measure -f cell", "apply -f cell --auto-approve", "snapshot -f cell --out host.json"):
        _rarms(folder, words)
    manifest.write_text(HEAD, encoding="utf-8")
    return _rarms(folder, "plan -f cell --snapshot onboard=host.json --output markdown")


def _rarms(folder: Path, words: str) -> str:
    command = [sys.executable, "-m", "rarms_iac", *words.split()]
    return subprocess.run(command, cwd=folder, stdout=subprocess.PIPE, text=True, check=False).stdout


def main() -> None:
    """Write the comment and its picture."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        comment = write_comment(folder)
        body = MarkdownIt("commonmark", {"html": True}).enable("table").render(comment)
        page = folder / "page.html"
        page.write_text(f"<meta charset=utf-8><style>{STYLE}</style><main>{body}</main>", encoding="utf-8")
        picture = FIGURES / "pull-request.png"
        flags = ["--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", f"--user-data-dir={folder}/c"]
        size = f"--window-size={WIDTH},{HEIGHT}"
        subprocess.run(["chromium", *flags, size, f"--screenshot={picture}", page.as_uri()], check=True)
    print(f"Wrote {picture}, {picture.stat().st_size} bytes.")


if __name__ == "__main__":
    main()
