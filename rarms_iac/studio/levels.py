"""Levels chosen together, by dragging or as a way out: what follows, the edit as a difference, its writing."""

import hashlib
from dataclasses import dataclass, replace

from pydantic import BaseModel, ConfigDict, Field

from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import ManifestSource, today_utc
from rarms_iac.app.select import SelectRequest, propose_levels, write_levels
from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.manifest.edit.formatting import diff_text
from rarms_iac.model.wording import in_a_row
from rarms_iac.views.console import UNLIMITED, render
from rarms_iac.views.select import selection_text


class LevelBody(BaseModel):
    """A level of an index of a component."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    component: str
    index: str
    level: str


class LevelsBody(BaseModel):
    """What the page sends."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    levels: list[LevelBody] = Field(min_length=1)
    digest: str = ""  # of the texts that were shown as a difference; empty: nothing is written


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelsAnswer:
    """What follows from levels."""

    text: str  # as `rarms select` says it
    difference: str  # of the manifest; empty: it says so already
    digest: str  # of the texts of the manifest's files, before


def answer_levels(source: ManifestSource, body: LevelsBody) -> LevelsAnswer:
    """Show what levels change together, or write all of them.

    Args:
        body: the levels, and whether they are written.

    Returns:
        The answer.

    Raises:
        RequestError: a level cannot be meant, or the manifest changed since the difference was shown.
        UseCaseError: as of `propose_levels` and `write_levels`.
    """
    manifest = load_manifest(replace(source, today=today_utc()))
    requests = [SelectRequest(component=each.component, level=each.level, index=each.index) for each in body.levels]
    proposal = propose_levels(manifest, requests)
    digest = hashlib.sha256("\0".join(edit.before for edit in proposal.edits).encode()).hexdigest()
    if body.digest:
        if body.digest != digest:
            names = in_a_row([edit.file for edit in proposal.edits])
            raise RequestError(f"The manifest ({names}) has changed since this difference was shown: look at it again.")
        write_levels(proposal)
    last = proposal.selections[-1]  # says the headroom, which is the same for all
    selections = (*(replace(each, totals={}, why_no_headroom="") for each in proposal.selections[:-1]), last)
    differences = (diff_text(edit.before, edit.after, edit.file, "as it is to be") for edit in proposal.edits)
    return LevelsAnswer(
        text="".join(render(selection_text(selection), UNLIMITED) for selection in selections),
        difference="".join(differences),
        digest=digest,
    )
