"""`rarms studio`: the paper's session as a page that this machine serves to its user."""

import tempfile
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from importlib.util import find_spec
from pathlib import Path
from threading import Thread

from rarms_iac.app.requests import ManifestSource, flag, option
from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.cli.command import rarms_command
from rarms_iac.cli.ending import ExitCode
from rarms_iac.cli.prompts import refuse_standard_input
from rarms_iac.cli.session import Session
from rarms_iac.storage.writing import replace as replace_file

NEEDED = ("starlette", "uvicorn")


@dataclass(frozen=True, slots=True, kw_only=True)
class StudioOptions:
    """How the page is served."""

    port: int | None = option(
        "--port", metavar="N", least=1, most=65535, help="Of the loopback interface. [default: any that is free]"
    )
    no_open: bool = flag("--no-open", help="Open no browser; print the address, which lets one browser in, on a line.")
    read_only: bool = flag("--read-only", help="Show everything, and change nothing.")


@rarms_command("studio", json=False)
def studio_command(session: Session, source: ManifestSource, options: StudioOptions) -> ExitCode:
    """Serve the manifest's folder as a page, to one browser on this machine, until Ctrl-C.

    The page of `rarms report`, alive: lines are dragged and written into the manifest; components are measured, tuned
    and proven; plans are made, applied and undone. Each part shows the command that does the same. The address works
    once; a second browser needs another `rarms studio`.
    """
    refuse_standard_input(source)
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        raise RequestError(
            f"rarms studio needs {' and '.join(missing)}, which this installation lacks.",
            "Install them from the clone: pipx install --force '.[studio]', or in its .venv: "
            ".venv/bin/pip install -e '.[studio]'.",
        )
    from rarms_iac.studio.page import StudioSettings
    from rarms_iac.studio.server import serve

    settings = StudioSettings(
        source=source,
        manifest_options=session.terminal.manifest_options,
        port=options.port or 0,
        read_only=options.read_only,
    )
    with _announcing(session, no_open=options.no_open) as announce:
        serve(settings, session.interrupts, announce)
    session.terminal.tell("The studio is closed.")
    return ExitCode.DONE


@contextmanager
def _announcing(session: Session, *, no_open: bool) -> Iterator[Callable[[str], None]]:
    """How the address reaches the user: printed, or in a file that only the user can read and a browser opens."""
    if no_open:
        yield lambda address: session.terminal.data_now(f"{address}\n")
        return
    with tempfile.TemporaryDirectory(prefix="rarms-studio-") as folder:  # only its user may enter it
        page = Path(folder) / "studio.html"

        def announce(address: str) -> None:
            replace_file(page, _leading_to(address))
            page.chmod(0o600)
            session.terminal.tell(f"The studio is open until Ctrl-C. If no browser shows it, open {page}.")
            # NOTE: in a thread. Some browsers are waited for, and this one would wait for the page meanwhile.
            Thread(target=webbrowser.open, args=(page.as_uri(),), daemon=True).start()

        yield announce


def _leading_to(address: str) -> bytes:
    """Return a page that leads on: the address itself, with its token, would stand in the list of processes."""
    target = escape(address)
    return (
        f'<!doctype html><meta charset="utf-8"><meta http-equiv="refresh" content="0; url={target}">'
        f'<title>rarms studio</title><p><a href="{target}">rarms studio</a></p>\n'
    ).encode()
