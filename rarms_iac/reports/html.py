"""The report as one HTML file: no network, nothing beside it, and a policy that lets nothing else in.

The content security policy names the digests of the page's own style and script; everything else is refused by the
browser, so that no text of a manifest or a log can become code even if escaping failed.
"""

import json
from base64 import b64encode
from functools import cache
from hashlib import sha256
from typing import TYPE_CHECKING

from rarms_iac.reports.candidate_drawing import drawing_of
from rarms_iac.reports.model import Report
from rarms_iac.reports.page import RESERVES, Card, cards_of, data_of
from rarms_iac.reports.summary import (
    fit_text,
    fits_of,
    proofs_of,
    standing_text,
    summary_of,
    trail_of,
    tuned_of,
    tuning_text,
)
from rarms_iac.statistics.told_errors import ERRORS
from rarms_iac.storage.shipped import shipped

if TYPE_CHECKING:
    from jinja2 import Environment

FOLDER = "templates/report"


def as_html(report: Report) -> bytes:
    """The whole page in UTF-8 with LF; the same report gives the same bytes."""
    cards, fits = cards_of(report), fits_of(report)
    style = _read("report.css") + _placed(cards)
    script = _read("report.js")
    text = (
        _environment()
        .get_template("report.html.j2")
        .render(
            report=report,
            cards=cards,
            summary=summary_of(report),
            fits=fits,
            told=[fit_text(one) for one in fits],
            proofs=proofs_of(report),
            tunings=[(one.platform, tuning_text(one), trail_of(one), tuned_of(one)) for one in report.tunings],
            combining=None if report.combining is None else drawing_of(report.combining.nodes),
            standings=[(one.host, standing_text(one), bool(one.differs)) for one in report.standings],
            reserves=RESERVES,
            errors=ERRORS,
            style=style,
            script=script,
            data=_inert(data_of(report, cards)),
            policy=_policy(style, script),
        )
    )
    return text.encode("utf-8", "replace")


def _policy(style: str, script: str) -> str:
    return (
        f"default-src 'none'; style-src {_digest(style)}; script-src {_digest(script)}; "
        "base-uri 'none'; form-action 'none'"
    )


def _digest(text: str) -> str:
    return f"'sha256-{b64encode(sha256(text.encode()).digest()).decode()}'"


def _inert(data: object) -> str:
    """JSON that can end no element: every sign that HTML reads is written as an escape."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _placed(cards: tuple[Card, ...]) -> str:
    """Where each line begins: a rule each, since the policy allows no style on an element."""
    return "".join(f"#{plot.id}-line {{ top: {plot.line}%; }}\n" for card in cards for plot in card.plots)


@cache
def _environment() -> "Environment":
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    return Environment(
        loader=FileSystemLoader(str(shipped(FOLDER)), encoding="utf-8"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        newline_sequence="\n",
    )


def _read(name: str) -> str:
    return (shipped(FOLDER) / name).read_text(encoding="utf-8").replace("\r\n", "\n")
