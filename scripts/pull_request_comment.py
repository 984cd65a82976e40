"""Writes a file as a comment of a pull request: AUTHOR's comment that begins with the same first line is updated.

A comment of another account is left alone, also one with that line: its author could change it after the plan is shown.

Asks GitHub's API as the steps of `action.yml` find it: GITHUB_API_URL, GITHUB_REPOSITORY, NUMBER and TOKEN. A token
that may not write, as pull requests from forks have, is told and no failure: the summary of the run has the same text.
"""

import json
import os
import sys
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.request import Request, urlopen

PAGE = 100
FORBIDDEN = frozenset({401, 403, 404})


def main(file: str) -> int:
    """Write the comment; 0 where it was written, or where the token may not."""
    if not Path(file).is_file():
        print("There is no comment to write: no plan was tried.")
        return 0
    body = Path(file).read_text(encoding="utf-8")
    comments = f"/repos/{os.environ['GITHUB_REPOSITORY']}/issues/{int(os.environ['NUMBER'])}/comments"
    try:
        earlier = _earlier(comments, body.split("\n", 1)[0])
        if earlier is None:
            print(f"Wrote {_ask('POST', comments, {'body': body})['html_url']}")
        else:
            path = f"/repos/{os.environ['GITHUB_REPOSITORY']}/issues/comments/{earlier}"
            print(f"Updated {_ask('PATCH', path, {'body': body})['html_url']}")
    except HTTPError as error:
        if error.code not in FORBIDDEN:
            raise
        print(f"::notice title=rarms::The token may not comment here ({error.code}): the run's summary has the plan.")
    return 0


def _earlier(comments: str, marker: str) -> int | None:
    """The id of the author's first comment with this marker."""
    author = os.environ["AUTHOR"]
    page = 1
    while found := _ask("GET", f"{comments}?per_page={PAGE}&page={page}"):
        for comment in found:
            is_own = (comment.get("user") or {}).get("login") == author
            if is_own and (comment["body"] or "").splitlines()[:1] == [marker]:
                return int(comment["id"])
        page += 1
    return None


def _ask(method: str, path: str, value: Any = None) -> Any:
    request = Request(  # GitHub's own address
        os.environ.get("GITHUB_API_URL", "https://api.github.com") + path,
        method=method,
        data=None if value is None else json.dumps(value).encode(),
        headers={
            "Accept": "application/vnd.github+json",
            "Authorization": f"Bearer {os.environ['TOKEN']}",
            "Content-Type": "application/json",
        },
    )
    with urlopen(request, timeout=30) as answer:  # likewise
        return json.load(answer)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
