"""A Hyper-V host: looked at by `observe.ps1`, or on this computer through WMI and the registry; changed by scripts."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import assert_never

from rarms_iac.model.commands import command, prose
from rarms_iac.model.host import Connect, Host, WinRmConnect
from rarms_iac.model.journal import ScriptRun
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.model.state import State
from rarms_iac.powershell.render import render_observe
from rarms_iac.powershell.templates import without_signature
from rarms_iac.providers.channel import CommandChannel, ssh_channel
from rarms_iac.providers.hyperv.condition import condition_of, findings_of, unread_error
from rarms_iac.providers.hyperv.observation import HostObservation, is_unread, observation_of, or_else
from rarms_iac.providers.hyperv.parse import JOURNAL, UnusableJournal, last_run_of, to_state
from rarms_iac.providers.hyperv.transport import (
    SHELLS,
    Listener,
    LocalTransport,
    RemotePowerShell,
    ScriptTransport,
    Transport,
    arguments_of,
)
from rarms_iac.providers.interface import (
    EventListener,
    HostDamaged,
    HostFailed,
    RunEvent,
    ScriptBundle,
    ScriptExited,
    ScriptLost,
    WaitLimits,
)
from rarms_iac.storage.codec import NotDecodable, decode
from rarms_iac.storage.json_text import parse_json
from rarms_iac.storage.reading import read_file
from rarms_iac.texts.messages import last_words, reason_of

OBSERVE_SECONDS = 300.0
OBSERVE = "observe.ps1"
LARGEST_SIGNED = 32 * 2**20  # bytes
EVENT_FORMAT = "rarms-event/1"
NATIVE_BUILD = 17763
"""The first build of Windows (Server 2019) whose Hyper-V module PowerShell 7 loads itself."""

LONGEST_LINE = 100_000
"""Characters of a line that is looked at; a script's own are far shorter."""


class LiveHypervHost:
    """A `ScriptedHost`. Each question is asked of the host again, except after `look_once`."""

    def __init__(self, host: Host, transport: Transport, signed_folder: Path | None = None) -> None:
        self._host = host
        self._transport = transport
        self._signed_folder = signed_folder
        self._looks_once = False
        self._document = ""  # of the one look

    def look_once(self) -> None:
        self._looks_once = True

    @property
    def name(self) -> str:
        """The host's name in the manifest."""
        return self._host.name

    def observe(self) -> State:
        observation = self.observation()
        if error := unread_error(observation, self.name):
            raise error
        return self._state(observation)

    def examined(self, application: str) -> SeenHost:
        observation = self.observation()
        return SeenHost(
            host=self._host,
            application=application,
            state=self._state(observation),
            condition=condition_of(observation),
            findings=findings_of(observation, self.name),
        )

    def _state(self, observation: HostObservation) -> State:
        try:
            return to_state(observation, self.name)
        except NotDecodable as error:
            raise self._unreadable(str(error)) from None

    def journal(self) -> ScriptRun | None:
        observation = self.observation()
        if is_unread(observation.journal):
            raise HostFailed(
                self.name,
                f"this account may not read {JOURNAL}",
                "Connect as a member of the host's Administrators group.",
            )
        run = last_run_of(observation)
        if isinstance(run, UnusableJournal):
            raise HostDamaged(self.name, f"{JOURNAL} {run.problem}", run.advice)
        return run

    def unfinished(self) -> ScriptRun | None:
        run = self.journal()
        return run if run is not None and run.unfinished else None

    def run_script(
        self, script: ScriptBundle, waits: WaitLimits, listener: EventListener, *, abandoning: bool = False
    ) -> ScriptExited | ScriptLost:
        arguments = arguments_of(waits, abandoning=abandoning)
        silence_s = (waits.silence_ms + waits.lock_ms + script.longest_grace_ms) / 1000
        return self._run(script, arguments, silence_s, _Events(listener))

    def _run(
        self, script: ScriptBundle, arguments: tuple[str, ...], silence_s: float, listener: Listener
    ) -> ScriptExited | ScriptLost:
        """Run the files, each as it was signed, where its signed copy says the same to the byte."""
        return self._transport.run(self._as_signed(script), arguments, silence_s, listener)

    def _as_signed(self, script: ScriptBundle) -> ScriptBundle:
        return replace(script, files={name: self._signed_copy(name, text) for name, text in script.files.items()})

    def _signed_copy(self, name: str, text: str) -> str:
        if self._signed_folder is None:
            return text
        try:
            copy = read_file(self._signed_folder / name, LARGEST_SIGNED).decode("ascii", "replace")
        except FileNotFoundError:
            return text
        except OSError as error:
            raise HostFailed(
                self.name, f"{self._signed_folder / name} cannot be read: {reason_of(error)}", "Repair or remove it."
            ) from None
        return copy if without_signature(copy) == text else text

    def recorded(self) -> bytes:
        """Return the document of the host, as `observe.ps1` prints it, with a line's end."""
        document = self._document_text()
        self._parse(document)
        return f"{document}\n".encode()

    def observation(self) -> HostObservation:
        """Look at the host now, or read what the one look gave.

        Raises:
            HostFailed: the host cannot be reached, or what it answers is not an observation.
        """
        return self._parse(self._document_text())

    def _document_text(self) -> str:
        """Return the document of the host as it is now, or as it was at the one look."""
        if self._looks_once and self._document:
            return self._document
        self._document = self._fetch()
        if self._lacks_hyperv(self._document):
            self._transport = self._transport.in_windows_powershell()
            self._document = self._fetch()
        return self._document

    def _lacks_hyperv(self, document: str) -> bool:
        """Return whether PowerShell 7 loaded Hyper-V through 5.1, whose objects no cmdlet takes."""
        observation = self._parse(document)
        powershell, windows = or_else(observation.powershell, None), or_else(observation.windows, None)
        if powershell is None or windows is None:
            return False
        return powershell.edition == "Core" and windows.build < NATIVE_BUILD

    def _fetch(self) -> str:
        """Return the output of `observe.ps1`, or on this computer the same from WMI and the registry."""
        if sys.platform == "win32" and isinstance(self._transport, LocalTransport):
            from rarms_iac.providers.hyperv.local_windows import observe_here

            return observe_here()
        script = ScriptBundle(runs=OBSERVE, files={OBSERVE: render_observe().decode("ascii")})
        document = _Document()
        ended = self._run(script, (), OBSERVE_SECONDS, document)
        match ended:
            case ScriptLost(why=why):
                raise HostFailed(
                    self.name,
                    f"the state of the host could not be read: {why}",
                    "Check whether the host is busy, then run the same command again.",
                )
            case ScriptExited(code=0):
                return document.text
            case ScriptExited(code=code, last_lines=lines):
                raise self._unreadable(last_words(" ".join(lines[-3:]), code))
            case _:
                assert_never(ended)

    def _parse(self, document: str) -> HostObservation:
        try:
            return observation_of(parse_json(document))
        except NotDecodable as error:
            raise self._unreadable(str(error)) from None

    def _unreadable(self, message: str) -> HostFailed:
        advice = prose(
            "Run the script there by hand and check its output: ", command("snapshot", script=True), " writes it."
        )
        return HostFailed(self.name, f"the output of {OBSERVE} cannot be read: {message}", advice)


def open_hyperv(host: Host, signed_folder: Path, channel: CommandChannel | None) -> LiveHypervHost:
    """Open the host that this describes.

    Args:
        channel: reaches it in place of what `connect` says.
    """
    return LiveHypervHost(host, transport_to(host, channel), signed_folder)


def transport_to(host: Host, channel: CommandChannel | None = None) -> Transport:
    """Return the way to a host: by a channel, by what `connect` says, or this computer's own PowerShell."""
    connect = host.connect
    if channel is None and connect is None:
        return LocalTransport(host.name)
    there = RemotePowerShell(SHELLS[0]) if connect is None else RemotePowerShell(connect.shell, connect.receiver)
    if channel is None and isinstance(connect, Connect):
        channel = ssh_channel(host.name, connect)
    elif channel is None and isinstance(connect, WinRmConnect):
        from rarms_iac.providers.hyperv.winrm import winrm_channel

        channel = winrm_channel(host.name, connect)
    assert channel is not None, "connect is one of these"
    return ScriptTransport(host.name, channel, there)


class _Events:
    """Lines as events for who listens to a run."""

    def __init__(self, listener: EventListener) -> None:
        self._listener = listener

    def line(self, text: str) -> None:
        event = read_event(text)
        if event is not None:
            self._listener.on_event(event)
        elif text.strip():
            self._listener.on_output(text)

    def should_stop(self) -> bool:
        return self._listener.should_stop()


class _Document:
    """The one line that is a document; what stands around it is noise of the host."""

    def __init__(self) -> None:
        self.text = ""

    def line(self, text: str) -> None:
        if text.startswith("{"):
            self.text = text

    def should_stop(self) -> bool:
        return False


def read_event(line: str) -> RunEvent | None:
    """Return the event that a line of a script's output is (docs/scripts.md), None where it is none of this format."""
    if len(line) > LONGEST_LINE or not line.startswith("{"):
        return None
    try:
        document = parse_json(line)
        if not isinstance(document, dict) or document.pop("format", None) != EVENT_FORMAT:
            return None
        event = decode(RunEvent, document)
    except NotDecodable:
        return None
    return event if 0 <= event.number <= event.total else None
