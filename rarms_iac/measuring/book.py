"""The settings of an experiment in its data log: the loop's memory, across kills."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rarms_iac.model.measurement import Setting
from rarms_iac.storage.datalog.files import append_setting, begin_log, read_log
from rarms_iac.storage.datalog.log import Header, Provenance, Recorded
from rarms_iac.storage.disk import make_folders


@dataclass(frozen=True, slots=True, kw_only=True)
class Book:
    """A `SettingsLog` in a file, which is begun with the first setting."""

    path: Path
    header: Header
    provenance: Callable[[], Provenance]  # of what is recorded now
    seed: int | None = None  # only settings of this seed count; None: all
    anew: bool = False  # what is there is stale, and gives way to the first setting

    def settings(self) -> tuple[Setting, ...]:
        """As the loop wants them.

        Raises:
            LogUnreadable: the file is no whole data log.
        """
        log = None if self.anew else read_log(self.path)
        known = () if log is None else log.settings
        return tuple(setting for setting in known if self.seed is None or setting.seed == self.seed)

    def add(self, setting: Setting) -> None:
        """Record one, whole or not at all."""
        if self._begins():
            make_folders(self.path.parent)
            begin_log(self.path, self.header)
        append_setting(self.path, Recorded(setting=setting, provenance=self.provenance()))

    def _begins(self) -> bool:
        """Whether the file is not yet this log: it is not there, has no header, or one that is stale."""
        log = read_log(self.path)
        return log is None or (self.anew and log.header != self.header)


def highest_seed(settings: tuple[Setting, ...]) -> int:
    """The last seed that anything was measured with; 0 where nothing was."""
    return max((setting.seed for setting in settings), default=0)
