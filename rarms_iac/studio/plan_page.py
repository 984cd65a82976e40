"""The plan of the page: its text and scripts, and what has changed since it was made."""

from dataclasses import dataclass

from rarms_iac.app.applying import changed_manifest
from rarms_iac.app.scripts import ScriptSince
from rarms_iac.model.commands import RecommendedCommand, plain_text, sentences
from rarms_iac.model.wording import in_a_row
from rarms_iac.studio.actions import Workspace
from rarms_iac.studio.knowledge import Knowledge
from rarms_iac.views.console import UNLIMITED, render
from rarms_iac.views.plan import plan_text
from rarms_iac.views.scripts import difference_text


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanOnPage:
    """The plan that was made last on the page."""

    id: str
    text: str  # as a terminal shows it
    details: str  # with --verbose: every attribute, reason and step, too
    command: RecommendedCommand  # that makes such a plan and does it
    is_made_anew: bool  # by that command, of a manifest that has changed: what it does is not this plan
    scripts: tuple[tuple[str, str, str, str], ...]  # name, text, plan that was applied last, difference to it
    can_be_applied: bool
    changed: tuple[str, ...]  # that the manifest or a host has changed since


def plan_on_page(known: Knowledge, workspace: Workspace, manifest_options: str) -> PlanOnPage | None:
    """Show the plan that was made last on the page.

    Args:
        manifest_options: what commands end with.

    Returns:
        None: there is none, or it was applied there.
    """
    plan = workspace.plan
    if plan is None:
        return None
    changes = changed_manifest(plan, workspace.source)
    notes = [plain_text(sentences(note.detail, note.advice), manifest_options) for note in changes]
    hosts = known.overview.hosts if known.overview else ()
    serials = {host.name: host.compared.serial for host in hosts if host.compared}
    moved = [part.name for part in plan.hosts if serials.get(part.name, part.serial) != part.serial]
    if moved:
        notes.append(f"Something was applied to {in_a_row(moved)} since this plan was made: plan again.")
    return PlanOnPage(
        id=plan.id,
        text=render(plan_text(plan, sources=known.sources), UNLIMITED, manifest=manifest_options),
        details=render(plan_text(plan, sources=known.sources, verbose=True), UNLIMITED, manifest=manifest_options),
        scripts=tuple(_script(since) for since in workspace.scripts),
        command=workspace.does,
        is_made_anew=bool(changes),
        can_be_applied=any(part.steps for part in plan.hosts) and not moved,
        changed=tuple(notes),
    )


def _script(since: ScriptSince) -> tuple[str, str, str, str]:
    difference = "" if since.difference is None else render(difference_text(since.difference), UNLIMITED)
    return since.script.name, since.script.text, since.applied, difference
