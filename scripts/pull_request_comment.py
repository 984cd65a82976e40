"""Writes a file as a comment of a pull or merge request: its author's comment with the same first line is updated.

A comment of another account is left alone, also one with that line: its author could change it after the plan is shown.

On GitHub it asks the API as the steps of `action.yml` find it: GITHUB_API_URL, GITHUB_REPOSITORY, NUMBER, AUTHOR and
TOKEN. In a merge request's pipeline of GitLab it asks GitLab's: CI_API_V4_URL, CI_PROJECT_ID, CI_MERGE_REQUEST_IID, and
a TOKEN of the account AUTHOR. A token that may not write, as pull requests from forks have, is reported and is not a
failure: the summary of the run has the same text.
"""

import json
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.error import HTTPError, URLError
from urllib.request import Request, urlopen

PAGE = 100
FORBIDDEN = frozenset({401, 403, 404})


@dataclass(frozen=True, slots=True, kw_only=True)
class Forge:
    """Where comments of one request are read and written, and what the answers call their parts."""

    comments: str  # address that lists comments, and takes a new one
    comment: str  # address of a comment, before its number
    headers: dict[str, str]
    update: str  # the method
    author: tuple[str, str]  # keys of a comment's author, and of that one's name

    def web_address(self, comment: dict[str, Any]) -> str:
        """Where people see a comment; GitLab does not say it."""
        return str(comment.get("html_url") or f"note {comment['id']}")


def find_forge() -> Forge:
    """Return the forge whose pipeline this is."""
    token = os.environ["TOKEN"]
    if gitlab := os.environ.get("CI_API_V4_URL"):
        request = int(os.environ["CI_MERGE_REQUEST_IID"])
        notes = f"{gitlab}/projects/{int(os.environ['CI_PROJECT_ID'])}/merge_requests/{request}/notes"
        headers = {"PRIVATE-TOKEN": token}
        return Forge(comments=notes, comment=notes, headers=headers, update="PUT", author=("author", "username"))
    # GitHub's own address
    issues = (
        f"{os.environ.get('GITHUB_API_URL', 'https://api.github.com')}/repos/{os.environ['GITHUB_REPOSITORY']}/issues"
    )
    return Forge(
        comments=f"{issues}/{int(os.environ['NUMBER'])}/comments",
        comment=f"{issues}/comments",
        headers={"Accept": "application/vnd.github+json", "Authorization": f"Bearer {token}"},
        update="PATCH",
        author=("user", "login"),
    )


def main(file: str) -> int:
    """Write the comment; 0 where it was written, or where the token may not, 1 where the server cannot be reached."""
    if not Path(file).is_file():
        print("There is no comment to write: no plan was tried.")
        return 0
    body, forge = Path(file).read_text(encoding="utf-8"), find_forge()
    try:
        earlier = _earlier(forge, body.split("\n", 1)[0])
        if earlier is None:
            print(f"Wrote {forge.web_address(_ask(forge, 'POST', forge.comments, {'body': body}))}")
        else:
            updated = _ask(forge, forge.update, f"{forge.comment}/{earlier}", {"body": body})
            print(f"Updated {forge.web_address(updated)}")
    except HTTPError as error:
        if error.code not in FORBIDDEN:
            print(f"::error title=rarms::The comment was not written: the server answered {error.code}.")
            return 1
        print(f"::notice title=rarms::The token may not comment here ({error.code}): the run's summary has the plan.")
    except (URLError, TimeoutError, ConnectionError) as error:
        reason = getattr(error, "reason", error)
        print(f"::error title=rarms::The comment was not written, since the server could not be reached: {reason}.")
        return 1
    return 0


def _earlier(forge: Forge, marker: str) -> int | None:
    """Return the id of the author's first comment with this marker."""
    whose, name = forge.author
    page = 1
    while found := _ask(forge, "GET", f"{forge.comments}?per_page={PAGE}&page={page}"):
        for comment in found:
            is_own = (comment.get(whose) or {}).get(name) == os.environ["AUTHOR"]
            if is_own and (comment["body"] or "").splitlines()[:1] == [marker]:
                return int(comment["id"])
        page += 1
    return None


def _ask(forge: Forge, method: str, address: str, value: Any = None) -> Any:
    request = Request(
        address,
        method=method,
        data=None if value is None else json.dumps(value).encode(),
        headers={**forge.headers, "Content-Type": "application/json"},
    )
    with urlopen(request, timeout=30) as answer:
        return json.load(answer)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
