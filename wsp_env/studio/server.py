"""The studio's server: workspaces, pages, and what was made in them; on this machine's loopback alone."""

import contextlib
import re
import secrets
import shutil
import signal
import socket
import sys
import tempfile
import webbrowser
from collections.abc import Iterator
from pathlib import Path

import uvicorn
from fastapi import FastAPI, HTTPException
from fastapi.responses import FileResponse, RedirectResponse, Response
from nicegui import app as nicegui_app
from nicegui import ui

from wsp_env.recordings.readers import FORMATS
from wsp_env.studio import shell
from wsp_env.studio.desk import Desk
from wsp_env.studio.desk_room import DeskRoom
from wsp_env.studio.gate import REPORT_POLICY, Gate
from wsp_env.studio.recordings_room import RecordingsRoom
from wsp_env.studio.workspace import Workspace

#: Workspaces and desks of one server: more tabs than anyone has open.
MOST_WORKSPACES = 40

_GRACE_S = 3  # for open pages once the server is asked to end: a page that does not answer is not waited for

_TERMINATED = 143  # exit status of a process that was asked to end (128 + SIGTERM)

_TYPES = {".html": "text/html; charset=utf-8", ".pdf": "application/pdf", ".json": "application/json",
          ".toml": "text/plain; charset=utf-8", ".py": "text/plain; charset=utf-8",
          ".xlsx": "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet"}  # fmt: skip
_ROOMS = (
    (
        "Recordings of stops",
        "Drop the logger's files, say which column is what, and forward a page that says what the recordings show and which "
        "physics they miss.",
        "Read recordings",
        "/recordings",
    ),
    (
        "Driving desk",
        "Brake a vehicle on a slippery rail: choose rail, law, controller and what differs from the book, and watch two stops "
        "side by side.",
        "Go to the driving desk",
        "/desk",
    ),
)
_SUFFIXES = tuple(suffix for group in FORMATS for suffix in group)


class Studio:
    """All workspaces of one server."""

    def __init__(self, folder: Path, most_bytes: int) -> None:
        self.folder, self._most_bytes = folder, most_bytes
        self.spaces: dict[str, Workspace] = {}
        self.desks: dict[str, Desk] = {}

    def new(self) -> str:
        """Return the key of a new workspace."""
        if len(self.spaces) + len(self.desks) >= MOST_WORKSPACES:
            raise HTTPException(429, f"{MOST_WORKSPACES} workspaces are open; restart wsp studio for more")
        return secrets.token_hex(6)

    def recordings(self) -> Response:
        """Begin a workspace; its address is the tab's own."""
        key = self.new()
        self.spaces[key] = Workspace(self.folder / key)
        return RedirectResponse(f"/recordings/{key}", 303)

    def desk(self) -> Response:
        """Begin a driving desk."""
        key = self.new()
        self.desks[key] = Desk(self.folder / key)
        return RedirectResponse(f"/desk/{key}", 303)

    def show_recordings(self, key: str) -> None:
        """Show a workspace."""
        if key in self.spaces:
            RecordingsRoom(self.spaces[key], key, self._most_bytes, _SUFFIXES)
        else:
            _gone("Recordings", "/recordings")

    def show_desk(self, key: str) -> None:
        """Show a driving desk."""
        if key in self.desks:
            DeskRoom(self.desks[key])
        else:
            _gone("Driving desk", "/desk")

    def left(self, key: str, task: str, name: str) -> Response:
        """Show what was made in a workspace; pages run by themselves, apart from the studio."""
        return self._hand_out(key, task, name, None)

    def file(self, key: str, task: str, name: str) -> Response:
        """Give what was made in a workspace as a file to keep."""
        return self._hand_out(key, task, name, name)

    def _hand_out(self, key: str, task: str, name: str, kept_as: str | None) -> Response:
        plain = re.fullmatch(r"[a-z]+", task) and re.fullmatch(r"[a-z]+\.[a-z]+", name)
        file = self.folder / key / task / name
        if key not in self.spaces or not plain or file.suffix not in _TYPES or not file.is_file():
            raise HTTPException(404)
        headers = {"content-security-policy": REPORT_POLICY, "cache-control": "no-store"}
        return FileResponse(file, media_type=_TYPES[file.suffix], headers=headers, filename=kept_as)


def welcome() -> None:
    """Show the two rooms."""
    with shell.page(""):
        shell.heading("What is at hand?", "Everything is computed on this machine, and nothing leaves it.")
        with ui.row().classes("w-full no-wrap items-stretch").style("gap: 1rem"):
            for card in _ROOMS:
                _room(*card)


def _room(title: str, words: str, action: str, address: str) -> None:
    with ui.element("section").classes("card column items-start").style("gap: .7rem; flex: 1"):
        ui.html(f"<h2>{title}</h2>", sanitize=False)
        ui.label(words).classes("grow")
        ui.button(action, on_click=lambda: ui.navigate.to(address)).props("unelevated no-caps")


def _gone(room: str, address: str) -> None:
    with shell.page(room), ui.element("main").classes("card column items-start").style("gap: .8rem"):
        shell.heading("This workspace is gone", "wsp studio was started anew since, and workspaces end with it.")
        ui.button("Begin a new one", on_click=lambda: ui.navigate.to(address)).props("unelevated no-caps")


def make_app(studio: Studio) -> FastAPI:
    """Return the application, without its gate."""
    app = FastAPI(openapi_url=None, docs_url=None, redoc_url=None)
    app.get("/recordings")(studio.recordings)
    app.get("/desk")(studio.desk)

    app.get("/left/{key}/{task}/{name}")(studio.left)
    app.get("/file/{key}/{task}/{name}")(studio.file)
    nicegui_app.add_static_files("/studio", Path(__file__).parent / "static")
    ui.page("/")(welcome)
    ui.page("/recordings/{key}")(studio.show_recordings)
    ui.page("/desk/{key}")(studio.show_desk)
    ui.run_with(app, title="wsp studio", show_welcome_message=False, favicon="🚆", reconnect_timeout=30.0)
    return app


@contextlib.contextmanager
def _place(kept: Path | None) -> Iterator[Path]:
    """Give a folder for workspaces: one that is kept, or one that ends with the server."""
    if kept is not None:
        kept.mkdir(parents=True, exist_ok=True)
        yield kept
        return
    folder = Path(tempfile.mkdtemp(prefix="wsp-studio-"))
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def serve(port: int = 0, show: bool = True, kept: Path | None = None, most_bytes: int = 2 * 10**9) -> None:
    """Serve until interrupted.

    Parameters
    ----------
    port : on the loopback; 0: any that is free
    show : open a browser
    kept : where workspaces are kept; None: in a folder that ends with the server
    most_bytes : of one file

    """
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as listening, _place(kept) as folder:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind(("127.0.0.1", port))
        listening.listen()  # who comes before the server is ready waits
        port = listening.getsockname()[1]
        token = secrets.token_urlsafe(24)
        studio = Studio(folder, most_bytes)
        # What surrounds a file in its request takes some hundred bytes.
        gate = Gate(make_app(studio), token, port, most_bytes + 10_000)
        address = f"http://127.0.0.1:{port}/?token={token}"
        print(f"The studio is at {address}\nOpen it in a browser on this machine; Ctrl-C ends it.", flush=True)
        if show:
            webbrowser.open(address)
        config = uvicorn.Config(
            gate,
            loop="asyncio",
            log_level="error",
            access_log=False,
            server_header=False,
            ws_max_size=2**24,
            timeout_graceful_shutdown=_GRACE_S,
        )
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(_TERMINATED))  # so that the folder is removed then too
        uvicorn.Server(config).run(sockets=[listening])
