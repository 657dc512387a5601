"""The server of the pages: on this machine alone, for whom has the token, in one folder."""

from __future__ import annotations

import asyncio
import hmac
import secrets
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from urllib.parse import urlsplit

import uvicorn
from fastapi import FastAPI
from nicegui import ui
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse, RedirectResponse
from starlette.responses import Response as Answer
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from cutbench.app.case_choices import Choice
from cutbench.app.cut_page import CutPage
from cutbench.app.data_page import DataPage
from cutbench.app.maps_page import MapsPage
from cutbench.app.page_parts import Bench
from cutbench.base.errors import BadInput
from cutbench.base.files import check_writable
from cutbench.base.report import packaged_text
from cutbench.emulator.atlas import shipped

HOST = "127.0.0.1"
#: Nothing is loaded from elsewhere, and no other page may hold this one.
_HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "SAMEORIGIN",
}
#: A plot that is fitted to its page while that is hidden says so; it is fitted again when it is shown.
_HIDDEN_PLOT = """<script>addEventListener("unhandledrejection", event => {
  if (/must be passed a displayed plot/.test(event.reason)) event.preventDefault(); });</script>"""
_TABS = ("Cut", "Maps", "Measured curves")


def workbench(folder: str | Path, token: str) -> FastAPI:
    """The application: all that it writes is in ``folder``; who has not the ``token`` is answered 403.

    There is one in a process, because the framework keeps its pages there.
    """
    bench = Bench(check_writable(folder).resolve())
    shipped().estimate(Choice().case())  # the atlas is read before anybody waits for it
    style = packaged_text("cutbench.app", "web/app.css")

    def page() -> None:
        ui.add_css(style)
        ui.add_body_html(_HIDDEN_PLOT)
        ui.colors(primary="#085a94")
        with ui.header(fixed=False).classes("items-center q-py-none gap-x-6"):
            ui.label("cutbench").classes("text-lg text-bold").props("role=heading aria-level=1")
            with ui.tabs().props('dense no-caps inline-label aria-label="What to do"') as tabs:
                made = [ui.tab(name).props(f"data-testid=tab-{name.split()[0].lower()}") for name in _TABS]
        with ui.tab_panels(tabs, value=made[0], animated=False).classes("w-full"):
            with ui.tab_panel(made[0]):
                cut = CutPage(bench)
            with ui.tab_panel(made[1]):
                maps = MapsPage(bench, cut)
            with ui.tab_panel(made[2]):
                DataPage(bench)
        tabs.on_value_change(lambda: maps.offer())

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        yield
        await asyncio.to_thread(bench.jobs.close)

    application = FastAPI(lifespan=lifespan, docs_url=None, redoc_url=None, openapi_url=None)
    application.mount("/files", StaticFiles(directory=bench.root, follow_symlink=False))
    ui.run_with(
        application, root=page, title="cutbench", favicon="🔪", dark=None, language="en-US",
        show_welcome_message=False, gzip_middleware_factory=None,
    )  # fmt: skip
    application.add_middleware(_Guard, token=token)
    application.add_middleware(TrustedHostMiddleware, allowed_hosts=[HOST, "localhost"])
    return application


class _Guard:
    """Lets pass who shows the token, in the address once and in a cookie from then on; adds headers."""

    def __init__(self, app: ASGIApp, token: str):
        self._app, self._token = app, token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            return await self._app(scope, receive, send)
        request = HTTPConnection(scope)
        # Browsers send one port's cookies to all ports of a host.
        cookie = f"cutbench_{(scope.get('server') or ('', 0))[1]}"
        given = request.query_params.get("token")
        if scope["type"] == "http" and given is not None and self._right(given):
            answer: Answer = RedirectResponse(request.url.path, 303)
            answer.set_cookie(cookie, self._token, httponly=True, samesite="strict")
            return await answer(scope, receive, send)
        # A page of another port of this machine would send the cookie, too, but it says where it is from.
        origin = request.headers.get("origin")
        stranger = origin is not None and urlsplit(origin).netloc != request.headers.get("host")
        if stranger or not self._right(request.cookies.get(cookie, "")):
            if scope["type"] == "websocket":
                return await send({"type": "websocket.close", "code": 1008})
            words = "Open the address that cutbench app has printed: it has the token of this server.\n"
            return await PlainTextResponse(words, 403)(scope, receive, send)

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                there = {name.lower() for name, _ in message["headers"]}
                own = [(k.lower().encode(), v.encode()) for k, v in _HEADERS.items()]
                message["headers"] = [*message["headers"], *(pair for pair in own if pair[0] not in there)]
            await send(message)

        await self._app(scope, receive, with_headers)

    def _right(self, given: str) -> bool:
        return hmac.compare_digest(given.encode(), self._token.encode())


def serve(folder: str | Path, port: int = 0, on_ready: Callable[[str], None] = print) -> None:
    """Serve until interrupted; ``on_ready`` has the address with its token. Raises BadInput for a port that
    is taken."""
    token = secrets.token_urlsafe(24)
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as listening:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind((HOST, port))
        except OSError as error:
            raise BadInput("--port", port, f"a port that is free ({error.strerror})") from error
        application = workbench(folder, token)
        listening.listen()
        on_ready(f"http://{HOST}:{listening.getsockname()[1]}/?token={token}")
        config = uvicorn.Config(application, log_level="warning", timeout_graceful_shutdown=1)
        uvicorn.Server(config).run(sockets=[listening])
