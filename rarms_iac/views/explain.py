"""`rarms explain`: the page of a finding, and how a component comes to the per cent that its partition gets."""

import re
from typing import TYPE_CHECKING

from rarms_iac.app.explanation import Explanation, HostExplanation
from rarms_iac.storage.shipped import known_codes
from rarms_iac.views.as_json import as_json
from rarms_iac.views.console import STRONG, columns, indented, paragraph, stack, styled
from rarms_iac.views.explanation_steps import NO_LAYOUT, steps_of
from rarms_iac.views.output.measuring import ComponentExplanationOutput, ExplanationStepOutput

if TYPE_CHECKING:
    from rich.console import RenderableType


_LINK = re.compile(r"\[([^\]]*)\]\([^)]*\)")
_BLOCK_STARTS = ("#", "- ", "* ", "```")


def unknown_code(code: str) -> str:
    """Say that a code has no page; NOTE: a number that is near says nothing of what was meant."""
    first, *_, last = known_codes()
    return f"There is no finding {code}: they lie between {first} and {last}, and docs/diagnostics.md lists them all."


def page_text(page: str) -> "RenderableType":
    """Lay out Markdown as plain text: headings underlined, paragraphs wrapped, code indented as it is."""
    parts: list[RenderableType] = []
    lines: list[str] = []
    in_code = False
    for line in [*page.splitlines(), ""]:
        if lines and (not line or line.startswith(_BLOCK_STARTS)):
            parts.append(paragraph(_LINK.sub(r"\1", " ".join(lines))))
            lines = []
        if line.startswith("```"):
            in_code = not in_code
        elif in_code:
            parts.append(_code(line))
        elif line.startswith("#"):
            title = line.lstrip("#").strip()
            parts += [styled(title), ("=" if line.startswith("# ") else "-") * columns(title)]
        elif line:
            lines.append(line.strip())
        else:
            parts.append("")
    return stack(*parts[:-1])


def _code(line: str) -> "RenderableType":
    """A line of an example, whole however narrow the terminal is: broken anew it would not be what rarms shows."""
    text = styled(line)
    text.no_wrap = True
    return indented(text, 4) if line else ""


def explanation_text(explanation: Explanation | HostExplanation, *, without_errors: bool = False) -> "RenderableType":
    """Lay out the explanation: what a step is about, its sentence behind it, and its other sentences below.

    Args:
        explanation: of a component.
        without_errors: leave out why there is no layout, since the findings beside the text say it.
    """
    component = explanation.component
    parts: list[RenderableType] = [paragraph(f"{component.name} (criticality {component.criticality})")]
    for step in steps_of(explanation):
        if without_errors and step.topic == NO_LAYOUT:
            continue
        first, *others = step.sentences
        parts.append(paragraph(styled((f"{step.topic}: ", STRONG), first), more=2))
        parts += [paragraph(sentence, indent=2) for sentence in others]
    return stack(*parts)


def explanation_json(explanation: Explanation | HostExplanation) -> str:
    """The same for programs."""
    component = explanation.component.name
    steps = tuple(ExplanationStepOutput(topic=step.topic, sentences=step.sentences) for step in steps_of(explanation))
    if isinstance(explanation, HostExplanation):
        return as_json(ComponentExplanationOutput(component=component, steps=steps))
    placed, has_host, least = explanation.placed, not explanation.no_host_because, explanation.least
    return as_json(
        ComponentExplanationOutput(
            component=component,
            partition=placed.name,
            host=placed.host,
            fits=not explanation.infeasibility,
            data_log=None if explanation.measured is None else explanation.measured.path,
            cr=None if least is None else least.reserve,
            interpolated=least is not None and least.interpolated,
            wanted_processors=None if explanation.wanted is None else float(explanation.wanted),
            reserved_processors=float(placed.reserved) if has_host else None,
            reserve=placed.reserve if has_host else None,
            processors=placed.processors,
            limit=placed.limit,
            weight=placed.weight,
            steps=steps,
        )
    )
