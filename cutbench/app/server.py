"""The server of the page: on this machine alone, for whom has the token, in one folder."""

from __future__ import annotations

import asyncio
import hmac
import json
import re
import secrets
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from importlib import resources
from pathlib import Path

import uvicorn
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import (
    HTMLResponse,
    JSONResponse,
    PlainTextResponse,
    RedirectResponse,
    StreamingResponse,
)
from starlette.responses import Response as Answer
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from cutbench.app.campaigns import MAX_FILE_BYTES, keep_file, write_campaign
from cutbench.app.case_choices import case_from_request, case_preview, materials, tools
from cutbench.app.jobs import STATES, Jobs
from cutbench.app.tasks import run, run_discovery, run_fit
from cutbench.base.errors import BadInput
from cutbench.base.files import check_writable
from cutbench.case.numerics import PRESETS

HOST = "127.0.0.1"
#: Seconds between two looks at what a job told.
_POLL_S = 0.1
#: Parts of the page in the order in which it has them.
_SCRIPTS = ("draw.js", "app.js")
#: Nothing is loaded from elsewhere, and no other page may hold this one.
_HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "SAMEORIGIN",
}


def workbench(folder: str | Path, token: str) -> Starlette:
    """The application: all that it writes is in ``folder``; who has not the ``token`` is answered 403."""
    root = check_writable(folder).resolve()
    jobs, taken = Jobs(), {"count": 0}

    def place(kind: str) -> Path:
        while True:
            taken["count"] += 1
            target = root / f"{kind}-{taken['count']}"
            if not target.exists():
                return target

    async def index(request: Request) -> Answer:
        return HTMLResponse(page())

    async def begin(request: Request) -> Answer:
        return JSONResponse(
            {"materials": materials(), "tools": tools(), "numerics": PRESETS, "maps": _maps(root)}
        )

    async def check(request: Request) -> Answer:
        return JSONResponse(case_preview(case_from_request(await _body(request))))

    async def start_run(request: Request) -> Answer:
        case = case_from_request(await _body(request))
        return JSONResponse(jobs.start(case.name, place("run"), run, case).summary(), 201)

    async def upload(request: Request) -> Answer:
        content = b""
        async for part in request.stream():
            content += part
            if len(content) > MAX_FILE_BYTES:
                raise BadInput("file", "larger", f"at most {MAX_FILE_BYTES} bytes")
        return JSONResponse(keep_file(root / "readings", request.path_params["name"], content), 201)

    async def start_campaign(request: Request) -> Answer:
        body = await _body(request)
        task = {"fit": run_fit, "discover": run_discovery}.get(str(body.get("task")))
        if task is None:
            raise BadInput("task", body.get("task"), "fit or discover")
        file = write_campaign(root / "readings", body)
        kept = place(str(body["task"]))
        kept.mkdir()
        (kept / "campaign.toml").write_bytes(file.read_bytes())
        return JSONResponse(jobs.start(file.stem, kept, task, file).summary(), 201)

    async def listed(request: Request) -> Answer:
        return JSONResponse([job.summary() for job in jobs])

    async def events(request: Request) -> Answer:
        if (job := jobs.get(request.path_params["id"])) is None:
            return PlainTextResponse("no such job", 404)

        async def told() -> AsyncIterator[str]:
            seen = 0
            while True:
                going = job.state == STATES[0]
                for what in job.messages[seen:]:
                    seen += 1
                    yield f"data: {json.dumps(what)}\n\n"
                if not going:
                    yield f"data: {json.dumps({'state': job.state, 'folder': job.folder.name})}\n\n"
                    return
                await asyncio.sleep(_POLL_S)

        return StreamingResponse(told(), media_type="text/event-stream")

    async def stop(request: Request) -> Answer:
        if (job := jobs.get(request.path_params["id"])) is None:
            return PlainTextResponse("no such job", 404)
        jobs.stop(job)
        return JSONResponse(job.summary())

    async def refused(request: Request, error: Exception) -> Answer:
        assert isinstance(error, BadInput)
        return JSONResponse({"error": str(error), "key": error.key}, 400)

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        yield
        jobs.close()

    routes = [
        Route("/", index),
        Route("/api/begin", begin),
        Route("/api/check", check, methods=["POST"]),
        Route("/api/runs", start_run, methods=["POST"]),
        Route("/api/files/{name}", upload, methods=["PUT"]),
        Route("/api/campaigns", start_campaign, methods=["POST"]),
        Route("/api/jobs", listed),
        Route("/api/jobs/{id}/events", events),
        Route("/api/jobs/{id}/stop", stop, methods=["POST"]),
        Mount("/files", StaticFiles(directory=root, follow_symlink=False)),
    ]
    guards = [
        Middleware(TrustedHostMiddleware, allowed_hosts=[HOST, "localhost"]),
        Middleware(_Guard, token=token),
    ]
    return Starlette(
        routes=routes, middleware=guards, lifespan=lifespan, exception_handlers={BadInput: refused}
    )


class _Guard:
    """Lets pass who shows the token, in the address once and in a cookie from then on; adds headers."""

    def __init__(self, app: ASGIApp, token: str):
        self._app, self._token = app, token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return await self._app(scope, receive, send)
        request = Request(scope)
        # Browsers send one port's cookies to all ports of a host.
        cookie = f"cutbench_{(scope.get('server') or ('', 0))[1]}"
        given = request.query_params.get("token")
        if given is not None and self._right(given):
            answer: Answer = RedirectResponse(request.url.path, 303)
            answer.set_cookie(cookie, self._token, httponly=True, samesite="strict")
            return await answer(scope, receive, send)
        if not self._right(request.cookies.get(cookie, "")):
            words = "Open the address that cutbench app has printed: it has the token of this server.\n"
            return await PlainTextResponse(words, 403)(scope, receive, send)

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                own = [(k.lower().encode(), v.encode()) for k, v in _HEADERS.items()]
                message["headers"] = [*message["headers"], *own]
            await send(message)

        await self._app(scope, receive, with_headers)

    def _right(self, given: str) -> bool:
        return hmac.compare_digest(given.encode(), self._token.encode())


def serve(folder: str | Path, port: int = 0, on_ready: Callable[[str], None] = print) -> None:
    """Serve until interrupted; ``on_ready`` has the address with its token. Raises BadInput for a port that
    is taken."""
    token = secrets.token_urlsafe(24)
    application = workbench(folder, token)
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as listening:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind((HOST, port))
        except OSError as error:
            raise BadInput("--port", port, f"a port that is free ({error.strerror})") from error
        on_ready(f"http://{HOST}:{listening.getsockname()[1]}/?token={token}")
        config = uvicorn.Config(application, log_level="warning", timeout_graceful_shutdown=1)
        uvicorn.Server(config).run(sockets=[listening])


def page() -> str:
    """The page, its style and its script in it."""
    parts = {"__STYLE__": _web("app.css"), "__SCRIPT__": "".join(map(_web, _SCRIPTS))}
    return re.sub("|".join(parts), lambda match: parts[match[0]], _web("app.html"))


def _web(name: str) -> str:
    return resources.files("cutbench.app").joinpath("web", name).read_text(encoding="utf-8")


def _maps(root: Path) -> list[str]:
    """Pages of maps in the folder, and one and two folders down."""
    found = [path for depth in ("", "*/", "*/*/") for path in root.glob(f"{depth}map.html")]
    return [path.relative_to(root).as_posix() for path in found if path.resolve().is_relative_to(root)]


async def _body(request: Request) -> dict:
    """The JSON object that a request holds. Raises BadInput."""
    try:
        body = await request.json()
    except (ValueError, UnicodeDecodeError):
        body = None
    if not isinstance(body, dict):
        raise BadInput("request", "no object", "a JSON object")
    return body
