"""The lab's server: the page, its modules, and one WebSocket for each open page."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator, Callable
from importlib import resources
from typing import TYPE_CHECKING, Any

from zenoh_cbef.errors import UserError
from zenoh_cbef.extras import from_extra
from zenoh_cbef.lab.answers import Page
from zenoh_cbef.lab.bench import Bench
from zenoh_cbef.lab.guard import HEADERS, Guard
from zenoh_cbef.plain import read_json
from zenoh_cbef.viewers.colours import LAYOUT

if TYPE_CHECKING:
    from starlette.applications import Starlette
    from starlette.requests import HTTPConnection, Request
    from starlette.responses import Response
    from starlette.websockets import WebSocket

_LOOK_SECONDS = 0.02
_LONGEST_WAIT = 25
"""How often in a row a page that asks for a newer frame is made to wait: half a second, then it gets what there is."""
_REFUSED = 4403
_TYPES = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".json": "application/json"}


def application(bench: Bench, guard: Guard, lifespan: Any = None) -> Starlette:
    """The lab as an ASGI application."""
    starlette = from_extra("starlette.applications", "the lab")
    from starlette.responses import PlainTextResponse, Response  # noqa: PLC0415 - time that only the lab should cost
    from starlette.routing import Route, WebSocketRoute  # noqa: PLC0415

    pages = resources.files("zenoh_cbef.pages")
    shared = (*(pages / "scene").iterdir(), pages / "style.css", resources.files("zenoh_cbef.viewers") / LAYOUT)
    served = (*(resources.files("zenoh_cbef.lab") / "page").iterdir(), *shared)
    files = {one.name: one.read_bytes() for one in served if one.is_file()}

    async def page(request: Request) -> Response:
        name = request.path_params.get("name", "")
        # The modules hold nothing secret, and a page's own requests for them carry no token.
        why = guard.refuses_host(request.headers) if name else guard.refuses(request.headers, _token(request))
        if why:
            return PlainTextResponse(why + "\n", 403, HEADERS)
        name = name or "index.html"
        kind = _TYPES.get(name[name.rfind(".") :])
        if name not in files or kind is None:
            return PlainTextResponse("there is no such page\n", 404, HEADERS)
        return Response(files[name], 200, HEADERS, media_type=kind)

    async def scenario(request: Request) -> Response:
        if why := guard.refuses(request.headers, _token(request)):
            return PlainTextResponse(why + "\n", 403, HEADERS)
        try:
            text = await asyncio.to_thread(bench.scenario_text)
        except UserError as error:
            return PlainTextResponse(f"{error}\n", 404, HEADERS)
        named = {"Content-Disposition": 'attachment; filename="session.toml"'}
        return PlainTextResponse(text, 200, HEADERS | named, media_type="application/toml")

    async def talk(websocket: WebSocket) -> None:
        if guard.refuses(websocket.headers, _token(websocket)):
            await websocket.close(_REFUSED)
            return
        await websocket.accept()
        await _serve(websocket, Page(bench))

    routes = [
        Route("/", page),
        Route("/scenario.toml", scenario),
        Route("/{name}", page),
        WebSocketRoute("/talk", talk),
    ]
    app: Starlette = starlette.Starlette(routes=routes, lifespan=lifespan)
    return app


def _token(request: HTTPConnection) -> str | None:
    return request.query_params.get("token")


async def _serve(websocket: WebSocket, page: Page) -> None:
    """Answer what one page asks, one question after the other: a page that is slow asks less often."""
    from starlette.websockets import WebSocketDisconnect  # noqa: PLC0415 - time that only the lab should cost

    try:
        while True:
            try:
                asked = read_json(await websocket.receive_text())
            except (ValueError, KeyError):
                asked = None
            if not isinstance(asked, dict):
                asked = {}
            for _ in range(_LONGEST_WAIT):
                if not page.waits(asked):
                    break
                await asyncio.sleep(_LOOK_SECONDS)
            await websocket.send_bytes(await asyncio.to_thread(page.answer, asked))
            page.answered(asked)
    except WebSocketDisconnect:
        return


def bound(host: str, port: int) -> socket.socket:
    """A socket that listens, at a free port for port 0. Raises UserError."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listening = socket.socket(family)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((host, port))
        listening.listen()
    except OSError as error:
        listening.close()
        raise UserError(f"cannot listen on {host} port {port}: {error.strerror}; choose another with --port") from None
    return listening


class Serving:
    """The server of one lab. ready: called when pages can be loaded. Raises MissingExtra without the extra `lab`."""

    def __init__(self, bench: Bench, guard: Guard, ready: Callable[[], None]) -> None:
        uvicorn = from_extra("uvicorn", "the lab")
        from_extra("websockets", "the lab")
        limits = {"ws": "websockets-sansio", "ws_max_size": 1 << 16, "timeout_graceful_shutdown": 1}

        @contextlib.asynccontextmanager
        async def lifespan(_: object) -> AsyncIterator[None]:
            ready()
            yield

        app = application(bench, guard, lifespan)
        self._server: Any = uvicorn.Server(uvicorn.Config(app, log_level="error", **limits))

    def run(self, listening: socket.socket) -> None:
        """Serve until Ctrl-C, or `stop`: both are a good end."""
        with contextlib.suppress(KeyboardInterrupt):
            self._server.run(sockets=[listening])

    def stop(self) -> None:
        """Make `run` return, from another thread."""
        self._server.should_exit = True


def address(listening: socket.socket, host: str, guard: Guard) -> str:
    """What to open in a browser."""
    name = f"[{host}]" if ":" in host else host
    return f"http://{name}:{listening.getsockname()[1]}/?token={guard.token}"
