"""The server: routes on the loopback interface, and the page's way to the use cases. Begin at `serve`.

Reading goes by GET and changes nothing; everything else is a POST of JSON from the page itself. Changes are sent as
server-sent events: the page then asks for itself again. All of it passes `guard`.
"""

import asyncio
import hashlib
import json
import socket
import time
from collections.abc import AsyncIterator, Callable
from dataclasses import asdict, dataclass, replace
from http import HTTPStatus
from threading import Event, Lock, Thread
from typing import TypeVar

import uvicorn
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request
from starlette.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import Mount, Route

from rarms_iac.app.control import StopSignal
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import ManifestSource, today_utc
from rarms_iac.app.select import SelectRequest, propose_levels, write_levels
from rarms_iac.app.use_case_errors import RequestError, UseCaseError
from rarms_iac.manifest.edit.formatting import diff_text
from rarms_iac.model.commands import sentences
from rarms_iac.model.diagnostics import in_order
from rarms_iac.storage.shipped import shipped_text
from rarms_iac.studio.actions import ACTIONS, Action, Workspace
from rarms_iac.studio.guard import LOOPBACK, MOST_ACCEPTED, BoundedProtocol, Guard, Keys, StudioServer, bind
from rarms_iac.studio.knowledge import Watch
from rarms_iac.studio.page import StudioSettings, page_of
from rarms_iac.studio.work import Ending, TaskRunner, Transcript, WorkRefused, WorkState
from rarms_iac.texts.messages import in_a_row
from rarms_iac.views.console import UNLIMITED, command_text, plain_text, render
from rarms_iac.views.findings_text import findings_text
from rarms_iac.views.questions import selection_text
from rarms_iac.views.reports.html import FOLDER, MODULES


class LevelBody(BaseModel):
    """A level of an index of a component."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    component: str
    index: str
    level: str


class LevelsBody(BaseModel):
    """The levels that the page sends."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    levels: list[LevelBody] = Field(min_length=1)
    digest: str = ""  # of the texts that were shown as a difference; empty: nothing is written


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelsAnswer:
    """The consequences of levels."""

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
            raise RequestError(
                f"The manifest ({names}) has changed since this difference was shown. Load the page again."
            )
        write_levels(proposal)
    last = proposal.selections[-1]  # says the headroom, which is the same for all
    selections = (*(replace(each, totals={}, why_no_headroom="") for each in proposal.selections[:-1]), last)
    differences = (diff_text(edit.before, edit.after, edit.file, "after the change") for edit in proposal.edits)
    return LevelsAnswer(
        text="".join(render(selection_text(selection), UNLIMITED) for selection in selections),
        difference="".join(differences),
        digest=digest,
    )


TICK_SECONDS = 0.2
"""How often work is looked at for news, and whether the end is asked for."""
TICKS_OF_FILES = 3
TICKS_OF_FILES_AT_WORK = 15
"""Files are looked at this seldom; while something runs seldom enough to leave the processors to it."""

MOST_BYTES = 65_536
"""Of a request's body."""
BODY_SECONDS = 10.0
"""For the body of a request."""

Body = TypeVar("Body", bound=BaseModel)

SCRIPTS = (*MODULES, "patch.js", "studio.js")


class StopBody(BaseModel):
    """The use case that is to end."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    number: int


class Studio:
    """The application behind the guard.

    Args:
        stop: says when what runs is to end.
        watch: keeps what is known; None: of the settings' manifest.
    """

    def __init__(self, settings: StudioSettings, stop: StopSignal, watch: Watch | None = None) -> None:
        self._settings = settings
        self._closed = Event()
        self._watch = watch or Watch(settings.source)
        self._workspace = Workspace(source=settings.source)
        self._writing = Lock()  # of the manifest
        self.work = TaskRunner(stop, settings.manifest_options, self._watch.forget)

    def routes(self) -> list[Route]:
        """Return the routes below the guard's path."""
        return [
            Route("/", self._page),
            Route("/style.css", self._style),
            Route("/modules/{name}", self._module),
            Route("/events", self._events),
            Route("/stop", self._stop_work, methods=["POST"]),
            Route("/levels", self._levels, methods=["POST"]),
            Route("/do/{action}", self._do, methods=["POST"]),
        ]

    def close(self) -> None:
        """End the events for browsers, so that their connections can end."""
        self._closed.set()

    async def _page(self, _request: Request) -> Response:
        return HTMLResponse(await run_in_threadpool(self._render))

    def _render(self) -> bytes:
        state = self.work.state()
        version = self._version(state)  # before the files are read: what changes meanwhile is read again
        return page_of(
            self._watch.knowledge(),
            self._workspace,
            self._settings,
            version=version,
            is_running=not state.ending,
        )

    def _version(self, state: WorkState) -> str:
        """Change with each file, and with each use case that begins or ends."""
        return f"{state.number}{state.ending}-{self._watch.version(is_running=not state.ending)}"

    async def _style(self, _request: Request) -> Response:
        text = f"{shipped_text(f'{FOLDER}/report.css')}{shipped_text(f'{FOLDER}/studio.css')}"
        return Response(text, media_type="text/css")

    async def _module(self, request: Request) -> Response:
        name = request.path_params["name"]
        if name not in SCRIPTS:
            return PlainTextResponse("This module does not exist.\n", HTTPStatus.NOT_FOUND)
        return Response(shipped_text(f"{FOLDER}/{name}"), media_type="text/javascript")

    async def _events(self, _request: Request) -> Response:
        return StreamingResponse(self._news(), media_type="text/event-stream")

    async def _news(self) -> AsyncIterator[str]:
        """Yield news of files and work, until the browser or the server ends."""
        sent_work = sent_files = ""
        latest: tuple[int, Ending] | None = None
        tick = 0
        while not self._closed.is_set():
            state = self.work.state()
            data = json.dumps(asdict(state))
            if data != sent_work:
                yield f"event: work\ndata: {data}\n\n"
                sent_work = data
            if latest != (state.number, state.ending):  # what began or ended is followed at once
                latest, tick = (state.number, state.ending), 0
            if tick % (TICKS_OF_FILES if state.ending else TICKS_OF_FILES_AT_WORK) == 0:
                version = await run_in_threadpool(self._version, state)
                if version != sent_files:
                    yield f"event: files\ndata: {version}\n\n"
                    sent_files = version
            tick += 1
            await asyncio.sleep(TICK_SECONDS)

    async def _stop_work(self, request: Request) -> Response:
        body = await _read(request, StopBody)
        if isinstance(body, Response):
            return body
        self.work.stop(body.number)
        return JSONResponse({})

    async def _levels(self, request: Request) -> Response:
        body = await _read(request, LevelsBody)
        if isinstance(body, Response):
            return body
        if self._settings.read_only and body.digest:
            return _read_only()
        try:
            answer = await run_in_threadpool(self._answer_levels, body)
        except (RequestError, UseCaseError) as error:
            return _refusal(self._describe(error))
        return JSONResponse(asdict(answer))

    def _answer_levels(self, body: LevelsBody) -> LevelsAnswer:
        """Answer one at a time: of two that were shown the same text the second is refused."""
        with self._writing:
            return answer_levels(self._settings.source, body)

    async def _do(self, request: Request) -> Response:
        kind = ACTIONS.get(request.path_params["action"])
        if kind is None:
            return PlainTextResponse("This action does not exist.\n", HTTPStatus.NOT_FOUND)
        body = await _read(request, kind)
        if isinstance(body, Response):
            return body
        if self._settings.read_only and kind.changes:
            return _read_only()
        return self._begin(body)

    def _begin(self, action: Action) -> Response:
        def task(transcript: Transcript, stop: StopSignal) -> Ending:
            return action.run(self._workspace, transcript, stop)

        try:
            self.work.start(command_text(action.command(), self._settings.manifest_options), task)
        except WorkRefused:
            return _refusal("An action is already running. Wait for its end, or stop it.")
        return JSONResponse({"number": self.work.state().number})

    def _describe(self, error: RequestError | UseCaseError) -> str:
        if isinstance(error, RequestError):
            return plain_text(sentences(error.message, error.advice), self._settings.manifest_options)
        text = findings_text(in_order(error.findings), error.sources)
        return render(text, UNLIMITED, manifest=self._settings.manifest_options)


async def _read(request: Request, kind: type[Body]) -> Body | Response:
    try:
        async with asyncio.timeout(BODY_SECONDS):
            body = await request.body()
    except TimeoutError:
        return PlainTextResponse("The body takes too long.\n", HTTPStatus.REQUEST_TIMEOUT, {"Connection": "close"})
    except ClientDisconnect:
        return Response(status_code=HTTPStatus.BAD_REQUEST)  # that no client hears
    try:
        return kind.model_validate_json(body)
    except ValidationError:
        return PlainTextResponse("The page sent an unknown request. Load the page again.\n", 422)


def _refusal(message: str) -> Response:
    return JSONResponse({"message": message}, HTTPStatus.CONFLICT)


def _read_only() -> Response:
    message = "This studio is read-only: it was started with --read-only."
    return JSONResponse({"message": message}, HTTPStatus.FORBIDDEN)


def guarded(studio: Studio, port: int, keys: Keys) -> Guard:
    """Put the guard before the studio.

    Args:
        port: of the loopback interface, which requests have to name.
    """
    routes = [Mount(f"/{keys.folder}", routes=studio.routes())]
    return Guard(Starlette(routes=routes, max_body_size=MOST_BYTES), port, keys)


def serve(
    settings: StudioSettings, stop: StopSignal, announce: Callable[[str], None], watch: Watch | None = None
) -> None:
    """Serve until the end is asked for; what runs then is stopped as in the terminal, and waited for.

    Use cases run in this thread, where a terminal's run, too: what a signal does to them is the same. The server has a
    thread of its own.

    Args:
        stop: asked several times a second.
        announce: called with the first address, with its token, once requests are taken.

    Raises:
        RequestError: the port is taken.
        KeyboardInterrupt: what ran was cut by a second signal, as in the terminal.
    """
    bound = bind(settings.port)
    port = int(bound.getsockname()[1])
    keys, studio = Keys(), Studio(settings, stop, watch)
    config = uvicorn.Config(
        guarded(studio, port, keys), log_config=None, access_log=False, server_header=False, lifespan="off",
        log_level="error",  # malformed requests are not printed on the terminal
        http=BoundedProtocol, backlog=MOST_ACCEPTED, ws="none", proxy_headers=False, timeout_graceful_shutdown=2,
    )  # fmt: skip
    server = StudioServer(config)

    # NOTE: a daemon. What it still has to say after the last word of the work is worth no waiting.
    thread = Thread(target=lambda: asyncio.run(server.serve(sockets=[bound])), name="rarms studio", daemon=True)
    thread.start()
    try:
        while not server.started and thread.is_alive():
            time.sleep(0.01)
        bound.listen(socket.SOMAXCONN)  # those that wait to be accepted wait in the kernel
        announce(f"http://{LOOPBACK}:{port}{keys.entrance}")
        while not stop.should_stop() and thread.is_alive():
            studio.work.run_next(TICK_SECONDS)
    except KeyboardInterrupt:
        if studio.work.was_cut:
            raise
    finally:
        studio.close()
        server.should_exit = True
        thread.join()
