"""The files in which a Linux host keeps what its partitions are: `<id>.json` a partition, in a folder of root."""

from pathlib import Path

from rarms_iac.providers.cgroups.definitions import GroupDefinition, read_definition, write_definition
from rarms_iac.providers.cgroups.effects import LinuxEffects, open_folder
from rarms_iac.providers.cgroups.refusals import out_of_range
from rarms_iac.providers.journaled import report_damage, report_failure
from rarms_iac.storage.codec import NotDecodable


class DefinitionFiles:
    """The definitions of one slice; what is saved or deleted is done when the effects are committed."""

    def __init__(self, host: str, folder: Path, effects: LinuxEffects) -> None:
        self._host = host
        self._folder = folder
        self._effects = effects

    def all(self) -> list[GroupDefinition]:
        """Read all definitions, sorted by id.

        Raises:
            HostDamaged: one cannot be read, or others than this user may write them.
        """
        self.refuse_writable_folder()
        names = self._effects.files(self._folder)
        return [self._load(self._folder / name) for name in names if name.endswith(".json")]

    def refuse_writable_folder(self) -> None:
        """Refuse a folder that others may write to, or that another user owns, as well as the one above it.

        Root must not finish what another user put there.

        Raises:
            HostDamaged: they may.
        """
        for folder in (self._folder.parent, self._folder):
            if self._effects.has_folder(folder) and not self._effects.is_private(folder):
                raise open_folder(self._host, folder)

    def save(self, definition: GroupDefinition) -> None:
        """Replace the file of a partition.

        Raises:
            HostFailed: it cannot be written.
        """
        with report_failure(self._host, path := self._file(definition)):
            self._effects.replace(path, write_definition(definition))

    def delete(self, definition: GroupDefinition) -> None:
        """Forget a partition.

        Raises:
            HostFailed: its file cannot be removed.
        """
        with report_failure(self._host, path := self._file(definition)):
            self._effects.delete(path)

    def _load(self, path: Path) -> GroupDefinition:
        with report_damage(self._host, path):
            definition = read_definition(self._effects.content(path) or b"")
            if f"{definition.id}.json" != path.name:
                raise NotDecodable("id", "the file has another name")
            if problem := out_of_range(definition.settings):
                raise NotDecodable("settings", problem)
            return definition

    def _file(self, definition: GroupDefinition) -> Path:
        return self._folder / f"{definition.id}.json"
