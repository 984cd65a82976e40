"""A level that was chosen by dragging: what follows from it, the edit as a difference, and its writing."""

import hashlib
from dataclasses import dataclass, replace

from pydantic import BaseModel, ConfigDict

from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import ManifestSource, today_utc
from rarms_iac.app.select import SelectRequest, select_level
from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.manifest.edit.formatting import diff_text
from rarms_iac.model.commands import RecommendedCommand, command
from rarms_iac.views.console import UNLIMITED, render
from rarms_iac.views.select import selection_text


class LevelBody(BaseModel):
    """What the page sends."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    component: str
    index: str
    level: str
    digest: str = ""  # of the text that was shown as a difference; empty: nothing is written

    def command(self) -> RecommendedCommand:
        """`rarms select`."""
        return command("select", self.component, at=self.level, index=self.index, dry_run=not self.digest)


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelAnswer:
    """What follows from a level."""

    text: str  # as `rarms select` says it
    difference: str  # of the manifest; empty: it says so already
    digest: str  # of the manifest's text, before
    after: str  # of its text with the level
    file: str  # that was written; empty: nothing was


def answer_level(source: ManifestSource, body: LevelBody) -> LevelAnswer:
    """Show what a level changes, or write it.

    Args:
        source: the manifest.
        body: the level, and whether it is written.

    Returns:
        The answer.

    Raises:
        RequestError: the level cannot be meant, or the manifest changed since the difference was shown.
        UseCaseError: as of `select_level`.
    """
    manifest = load_manifest(replace(source, today=today_utc()))
    request = SelectRequest(component=body.component, level=body.level, index=body.index)
    selection = select_level(manifest, replace(request, dry_run=True))
    edit = selection.edit
    assert edit is not None, "a level that can be had comes with its edit"
    digest = _digest(edit.before)
    if body.digest:
        if body.digest != digest:
            raise RequestError(f"{edit.file} has changed since this difference was shown: look at it again.")
        selection = select_level(manifest, request)
    return LevelAnswer(
        text=render(selection_text(selection), UNLIMITED),
        difference=diff_text(edit.before, edit.after, edit.file, "with this level"),
        digest=digest,
        after=_digest(edit.after),
        file=selection.file,
    )


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
