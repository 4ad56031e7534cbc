"""The server of the workbench: this machine alone, or with a token others too."""

import secrets
from pathlib import Path
from urllib.parse import parse_qs

from nicegui import app, ui
from starlette.datastructures import Headers
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import cookie_parser
from starlette.responses import PlainTextResponse, RedirectResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from . import jobs
from .page import build
from .project import Project

LOCAL = ("127.0.0.1", "localhost")


class TokenGate:
    """Lets pass who has the token as a cookie; gives the cookie to who brings it in the address."""

    def __init__(self, inner: ASGIApp, token: str, cookie: str) -> None:
        self._inner, self._token, self._cookie = inner, token, cookie

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """As ASGI has it."""
        if scope["type"] not in ("http", "websocket"):
            await self._inner(scope, receive, send)
            return
        kept = cookie_parser(Headers(scope=scope).get("cookie", "")).get(self._cookie, "")
        if self._is(kept):
            await self._inner(scope, receive, send)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        elif self._is(self._brought(scope)):
            answer = RedirectResponse("/")
            answer.set_cookie(self._cookie, self._token, httponly=True, samesite="lax")
            await answer(scope, receive, send)
        else:
            words = "The workbench needs the address with its token, which it printed.\n"
            await PlainTextResponse(words, 403)(scope, receive, send)

    def _is(self, text: str) -> bool:
        return secrets.compare_digest(text.encode(), self._token.encode())

    @staticmethod
    def _brought(scope: Scope) -> str:
        return "".join(parse_qs(scope.get("query_string", b"").decode(errors="replace")).get("token", []))


def serve(folder: Path, host: str, port: int) -> None:
    """Serve a project until Ctrl-C; prints the address.

    Raises:
        InputError: another workbench serves the project.
    """
    project = Project(folder)
    with jobs.claim(project):
        build(project)
        _listen(project, host, port)


def _listen(project: Project, host: str, port: int) -> None:
    address = f"http://{'127.0.0.1' if host in LOCAL else host}:{port}/"
    if host in LOCAL:
        app.add_middleware(TrustedHostMiddleware, allowed_hosts=list(LOCAL))
    else:
        token = secrets.token_urlsafe(24)
        app.add_middleware(TokenGate, token=token, cookie=f"subsoil_workbench_{port}")
        address += f"?token={token}"
    print(f"workbench of {project.folder}: {address} (Ctrl-C ends it; runs go on)", flush=True)
    ui.run(
        host=host,
        port=port,
        show=False,
        reload=False,
        show_welcome_message=False,
        uvicorn_logging_level="warning",
    )
