"""A way to a host that is a twin in this very process: scripts go there as files, and what they print comes back."""

from collections.abc import Sequence
from dataclasses import dataclass

from rarms_iac.providers.hyperv.transport import Listener
from rarms_iac.providers.interface import HostFailed, ScriptBundle, ScriptExited, ScriptLost
from tests.twin.host import WindowsHost
from tests.twin.run import put, run


@dataclass(slots=True)
class TwinTransport:
    """Runs on this host; what is printed `before` and `after` is not the script's. A host of None is out of reach."""

    host: WindowsHost | None
    before: str = ""
    after: str = ""

    def run(
        self, script: ScriptBundle, arguments: Sequence[str], silence_s: float, listener: Listener
    ) -> ScriptExited | ScriptLost:
        """As the protocol says; every line is heard before the script's end is."""
        if self.host is None:
            raise HostFailed("onboard", "nobody answers", "plug it in")
        put(self.host, {name: text.encode("ascii") for name, text in script.files.items()})
        ran = run(self.host, script.runs, as_json="-AsJson" in arguments, abandon="-Abandon" in arguments)
        for line in (self.before, *ran.lines, self.after):
            listener.line(line)
        return ScriptLost(why="it was killed") if ran.code is None else ScriptExited(code=ran.code, last_lines=ran.talk)
