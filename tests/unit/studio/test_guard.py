"""Who may talk to the studio: everything but the one browser, by its cookie, from the studio's own page, gets 403."""

import socket
from collections.abc import Iterator, Mapping
from http.cookies import SimpleCookie
from pathlib import Path

import pytest

from rarms_iac.studio.guard import POLICY
from rarms_iac.studio.server import MOST_BYTES
from tests.needs import CHECKOUT
from tests.unit.studio.studio_client import Client, studio

TEMPLATE = (CHECKOUT / "templates/init/tutorial.yaml").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cell")
    (folder / "rarms.yaml").write_text(TEMPLATE, encoding="utf-8", newline="\n")
    return folder


@pytest.fixture(scope="module")
def client(folder: Path) -> Iterator[Client]:
    with studio(folder) as entered:
        entered.enter()
        yield entered


@pytest.fixture
def fresh(folder: Path) -> Iterator[Client]:
    with studio(folder) as client:
        yield client


def allowed(client: Client) -> Mapping[str, str]:
    """What the page itself sends."""
    return {"Cookie": client.cookie, "Origin": client.origin, "Content-Type": "application/json"}


ADDRESSES = ("", "style.css", "modules/studio.js", "events", "nothing", "enter", "enter?token=", "enter?token=x")


def test_without_the_cookie_every_address_answers_403(client: Client) -> None:
    for name in ADDRESSES:
        assert client.send("GET", client.path + name, {}).status == 403, name
        assert client.send("GET", client.path + name, {"Cookie": f"rarms-studio-{client.port}=x"}).status == 403, name
    for name in ("stop", "levels", "do/plan"):
        assert client.send("POST", client.path + name, {**allowed(client), "Cookie": ""}, b"{}").status == 403, name
    assert client.send("GET", "/", {"Cookie": client.cookie}).status == 403
    assert client.send("GET", "/favicon.ico", {"Cookie": client.cookie}).status == 403


def test_token_works_once_and_cookie_is_private(fresh: Client) -> None:
    first, again = fresh.enter(), Client(address=fresh.address).enter()

    assert (first.status, again.status) == (200, 403)
    assert "set-cookie" not in again.headers
    [cookie] = SimpleCookie(first.headers["set-cookie"]).values()
    assert (cookie["httponly"], cookie["samesite"], cookie["path"]) == (True, "strict", fresh.path)
    assert int(cookie["max-age"]) > 24 * 3600, "a browser that was closed for a night finds the run again"
    assert fresh.get().status == 200
    assert f'url={fresh.path}"' in again.text, "the browser that has the cookie is led to the page"


def test_foreign_cookie_does_not_lock_out(client: Client) -> None:
    name, _, _ = client.cookie.partition("=")

    for cookies in (f"{name}=x; {client.cookie}", f"{client.cookie}; {name}=x", f"{name}=; a=b;{client.cookie}"):
        assert client.send("GET", client.path, {"Cookie": cookies}).status == 200, cookies
    assert client.send("GET", client.path, {"Cookie": f"{name}=x; {name}=y"}).status == 403


def test_refusal_closes_and_gives_advice(client: Client) -> None:
    refused = client.send("GET", client.path, {})

    assert refused.headers["connection"] == "close"
    assert "end rarms studio with Ctrl-C and start it again" in refused.text


def test_wrong_token_leaves_right_one_as_it_was(fresh: Client) -> None:
    assert fresh.send("GET", f"{fresh.path}enter?token=wrong", {}).status == 403
    assert fresh.enter().status == 200


@pytest.mark.parametrize("host", ["localhost:{port}", "studio.example:{port}", "127.0.0.1", "127.0.0.1:1", ""])
def test_another_name_of_the_host_is_refused(client: Client, host: str) -> None:
    headers = {"Cookie": client.cookie, "Host": host.format(port=client.port)}

    assert client.send("GET", client.path, headers).status == 403


@pytest.mark.parametrize("origin", ["http://studio.example", "null", "http://127.0.0.1:1", "https://127.0.0.1:{port}"])
def test_another_origin_is_refused_also_with_the_cookie(client: Client, origin: str) -> None:
    headers = {**allowed(client), "Origin": origin.format(port=client.port)}

    assert client.send("POST", f"{client.path}do/plan", headers, b"{}").status == 403
    assert client.send("GET", client.path, headers).status == 403


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_page_of_another_site_or_port_is_refused(client: Client, site: str) -> None:
    assert client.get(**{"Sec-Fetch-Site": site}).status == 403
    assert client.get("modules/studio.js", **{"Sec-Fetch-Site": site}).status == 403
    assert client.get(**{"Sec-Fetch-Site": "same-origin"}).status == 200


@pytest.mark.parametrize("lacking", ["Origin", "Content-Type"])
def test_foreign_post_is_refused(client: Client, lacking: str) -> None:
    headers = {name: value for name, value in allowed(client).items() if name != lacking}

    assert client.send("POST", f"{client.path}stop", headers, b"{}").status == 403


def test_bodies_are_bounded(client: Client) -> None:
    address, own = f"{client.path}stop", allowed(client)
    chunks = b"%x\r\n%s\r\n0\r\n\r\n" % (MOST_BYTES + 1, b" " * (MOST_BYTES + 1))

    assert client.send("POST", address, own, b'{"number": 0}'.ljust(MOST_BYTES)).status == 200
    assert client.send("POST", address, {**own, "Content-Length": str(MOST_BYTES + 1)}).status == 413
    assert client.send("POST", address, {**own, "Transfer-Encoding": "chunked"}, chunks).status == 413
    both = {**own, "Transfer-Encoding": "chunked", "Content-Length": "2"}
    assert client.send("POST", address, both, chunks).status == 413


@pytest.mark.parametrize("name", ["stop", "levels", "do/plan", "do/apply", "do/measure"])
def test_nothing_is_done_by_get(client: Client, name: str) -> None:
    assert client.get(name).status == 405


def test_every_answer_has_the_strict_policy(client: Client) -> None:
    for answer in (client.get(), client.get("style.css"), client.get("nothing"), client.send("GET", "/", {})):
        assert answer.headers["content-security-policy"] == POLICY
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["referrer-policy"] == "no-referrer"
        assert answer.headers["cache-control"] == "no-store"
    assert "unsafe" not in POLICY
    assert "http" not in POLICY


def test_it_listens_on_the_loopback_interface_alone(client: Client) -> None:
    other = "127.0.0.2"  # any other address of this machine
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection((other, client.port), timeout=5)


@pytest.mark.parametrize("body", [b"[]", b"{", b'{"plan": 1}', b'{"foreign": true}', b'{"components": "control"}'])
def test_body_that_page_does_not_send_is_refused(client: Client, body: bytes) -> None:
    for name in ("do/measure", "levels"):
        assert client.send("POST", f"{client.path}{name}", allowed(client), body).status == 422, name


def test_no_other_actions_or_modules(client: Client) -> None:
    assert client.post("do/destroy", {}).status == 404
    assert client.get("modules/..%2f..%2finit%2frarms.yaml").status == 404
    assert client.get("modules/report.css").status == 404
