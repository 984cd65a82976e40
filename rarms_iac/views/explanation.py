"""How a component comes to what its partition gets, as `rarms explain COMPONENT` shows it."""

from typing import TYPE_CHECKING

from rarms_iac.app.explanation import ComponentExplanation
from rarms_iac.views.console import STRONG, paragraph, stack, styled
from rarms_iac.views.explanation_steps import explanation_steps

if TYPE_CHECKING:
    from rich.console import RenderableType


def explanation_text(explanation: ComponentExplanation, *, without_infeasibility: bool) -> "RenderableType":
    """Lay out the explanation: what a step is about, its sentence behind it, and its other sentences below.

    Args:
        explanation: of a component.
        without_infeasibility: leave out why there is no layout, since the findings beside the text say it.
    """
    parts: list[RenderableType] = [paragraph(f"{explanation.component} (criticality {explanation.criticality})")]
    for step in explanation_steps(explanation):
        if without_infeasibility and step.repeats_findings:
            continue
        first, *others = step.sentences
        parts.append(paragraph(first, lead=styled((f"{step.topic}: ", STRONG)), more=2))
        parts += [paragraph(sentence, indent=2) for sentence in others]
    return stack(*parts)
