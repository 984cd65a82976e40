"""`rarms explain COMPONENT`, for people and for programs."""

from rarms_iac.app.explanation import Explanation, HostExplanation
from rarms_iac.views.as_json import as_json
from rarms_iac.views.diagnostics.layout import wrap
from rarms_iac.views.output.measuring import WalkOutput, WalkStepOutput
from rarms_iac.views.walk_steps import steps_of

WIDTH = 80
_MARGIN = "  "


def walk_text(walk: Explanation | HostExplanation, width: int = WIDTH) -> str:
    """The walk for a terminal of so many columns."""
    lines = [f"{walk.component.name} (criticality {walk.component.criticality})", ""]
    for step in steps_of(walk):
        lines.append(step.topic)
        for sentence in step.says:
            lines += wrap(sentence, width, _MARGIN)
    return "\n".join(lines) + "\n"


def walk_json(walk: Explanation | HostExplanation) -> str:
    """The same for programs."""
    return as_json(_on_the_host(walk) if isinstance(walk, HostExplanation) else _in_a_partition(walk))


def _in_a_partition(walk: Explanation) -> WalkOutput:
    placed, known = walk.placed, not walk.cannot
    return WalkOutput(
        component=walk.component.name,
        partition=placed.name,
        host=placed.host,
        fits=not walk.misfit,
        data_log=None if walk.measured is None else walk.measured.path,
        cr=None if walk.least is None else walk.least.reserve,
        interpolated=walk.least is not None and walk.least.interpolated,
        wanted_processors=None if walk.wanted is None else float(walk.wanted),
        reserved_processors=float(placed.reserved) if known else None,
        reserve=placed.reserve if known else None,
        processors=placed.processors,
        limit=placed.limit,
        weight=placed.weight,
        steps=_steps(walk),
    )


def _on_the_host(walk: HostExplanation) -> WalkOutput:
    return WalkOutput(
        component=walk.component.name,
        partition=None,
        host=None,
        fits=True,
        data_log=None,
        cr=None,
        interpolated=False,
        wanted_processors=None,
        reserved_processors=None,
        reserve=None,
        processors=None,
        limit=None,
        weight=None,
        steps=_steps(walk),
    )


def _steps(walk: Explanation | HostExplanation) -> tuple[WalkStepOutput, ...]:
    return tuple(WalkStepOutput(topic=step.topic, says=step.says) for step in steps_of(walk))
