"""What all pages of the studio share: look, header, small parts."""

from collections.abc import Callable, Sequence
from typing import Any

from nicegui import background_tasks, ui

from wsp_env.report import COLOURS
from wsp_env.studio.workspace import RefusedError

ACCENT, WARN = COLOURS[0], COLOURS[1]

_STYLE = """
body { background: #f6f7f9; color: #1f2933; font-family: system-ui, sans-serif; }
.q-btn { text-transform: none; letter-spacing: 0; }
h1 { font-size: 1.5rem; font-weight: 600; margin: 0; line-height: 1.3; outline: none; }
h2 { font-size: 1.05rem; font-weight: 600; margin: 0; line-height: 1.4; }
.card { background: white; border: 1px solid #e3e7ec; border-radius: 10px; padding: 1.2rem 1.4rem; width: 100%; }
.quiet { color: #616e7c; } .small { font-size: .86rem; }
.warn { border-left: 4px solid #D55E00; background: #fdf3ec; padding: .5rem .9rem; border-radius: 4px; }
.good { border-left: 4px solid #009E73; background: #eef8f4; padding: .5rem .9rem; border-radius: 4px; }
.warn, .good { overflow-wrap: anywhere; }
a:focus-visible, .q-btn:focus-visible, summary:focus-visible { outline: 3px solid #56B4E9; outline-offset: 2px; }
.studio-drop { width: 100%; border: 2px dashed #b7c2cd; border-radius: 10px; background: white; max-height: none; }
.studio-drop .q-uploader__header { background: transparent; color: inherit; }
.studio-drop .q-uploader__list { display: none; }
.studio-drop.q-uploader--dnd, .studio-drop:focus-within { border-color: #0072B2; }
table.plain { border-collapse: collapse; font-variant-numeric: tabular-nums; }
table.plain th, table.plain td { padding: .3rem .9rem; border-bottom: 1px solid #e3e7ec; text-align: right; }
table.plain th:first-child, table.plain td:first-child { text-align: left; }
table.plain th { color: #616e7c; font-weight: 500; }
.report { width: 100%; height: 75vh; border: 1px solid #e3e7ec; border-radius: 10px; background: white; }
.step { color: #616e7c; } .step.now { color: #0072B2; font-weight: 600; } .step .q-btn__content { flex-wrap: nowrap; }
.track-play { border: 1px solid #0072B2; color: #0072B2; border-radius: 4px; padding: .25rem .9rem; min-width: 6.5rem; }
.track-play:focus-visible { outline: 3px solid #56B4E9; }
"""

_DROP = """
<div class="column items-center q-pa-md" style="gap: .5rem">
  <div class="quiet">WORDS</div>
  <q-btn outline color="primary" label="LABEL" @click="props.pickFiles"><q-uploader-add-trigger /></q-btn>
  <q-linear-progress v-if="props.isUploading" :value="props.uploadedSize / Math.max(props.uploadSize, 1)" color="primary" />
</div>
"""


def page(room: str) -> Any:
    """Begin a page: title, style, header; return its body, a column."""
    ui.colors(primary=ACCENT)
    ui.page_title("wsp studio")
    ui.add_css(_STYLE)
    ui.add_head_html('<script src="/studio/names.js"></script>')
    with (
        ui.header().classes("items-center q-px-lg").style("background: white; color: #1f2933; border-bottom: 1px solid #e3e7ec")
    ):
        ui.link("wsp studio", "/").style("font-weight: 700; color: #1f2933; text-decoration: none; margin-right: 2rem")
        for words, address in (("Recordings", "/recordings"), ("Driving desk", "/desk")):
            link = ui.link(words, address)
            now = words == room
            link.style(f"color: {ACCENT if now else '#616e7c'}; text-decoration: none; font-weight: {600 if now else 400}")
            if now:
                link.props("aria-current=page")
    return ui.column().classes("w-full q-mx-auto q-pa-md").style("max-width: 1280px; gap: 1rem")


def heading(words: str, lead: str = "") -> None:
    """Show what a screen is for; the screen begins here for who reads it by ear or keyboard."""
    ui.html(f"<h1 tabindex='-1' id='top'>{_escaped(words)}</h1>", sanitize=False)
    if lead:
        ui.label(lead).classes("quiet").style("max-width: 60rem")


def focus_top() -> None:
    """Put the keyboard at the heading."""
    ui.run_javascript("document.getElementById('top')?.focus({preventScroll: true}); window.scrollTo(0, 0)")


def primary(words: str, act: Callable[[], Any], disabled: bool = False) -> Any:
    """Show the one action of a screen."""
    button = ui.button(words, on_click=act).props("unelevated size=md no-caps")
    if disabled:
        button.disable()
    return button


def secondary(words: str, act: Callable[[], Any]) -> Any:
    """Show another action."""
    return ui.button(words, on_click=act).props("flat no-caps")


def drop(words: str, label: str, take: Callable[[Any], Any], most_bytes: int, multiple: bool, accept: Sequence[str]) -> Any:
    """Show a place to drop files at, with a button that opens the file dialogue."""
    upload = ui.upload(
        multiple=multiple,
        auto_upload=True,
        max_file_size=most_bytes,
        on_upload=take,
        on_rejected=lambda: ui.notify(f"Not taken: {', '.join(accept)} of at most {most_bytes / 1e6:.0f} MB", type="warning"),
    )
    upload.props(f"flat accept='{','.join(accept)}'").classes("studio-drop")
    upload.add_slot("header", _DROP.replace("WORDS", _escaped(words)).replace("LABEL", _escaped(label)))
    return upload


def table(shown: dict[str, Any]) -> None:
    """Show a table of text cells."""

    def row(cells: Sequence[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{_escaped(str(cell))}</{tag}>" for cell in cells) + "</tr>"

    rows = "".join(row(cells, "td") for cells in shown["rows"])
    ui.html(f"<table class='plain'>{row(shown['header'], 'th')}{rows}</table>", sanitize=False).classes("overflow-auto w-full")


def note(words: str, kind: str = "warn") -> None:
    """Show a sentence that must not be overlooked."""
    ui.label(words).classes(f"{kind} w-full")


def begin(work: Any) -> None:
    """Let work go on while pages live on."""
    background_tasks.create(work)


def tried(act: Callable[[], Any]) -> Callable[..., None]:
    """Return an action that says why it was refused."""

    def attempt(*_: Any) -> None:
        try:
            act()
        except RefusedError as error:
            ui.notify(str(error), type="warning", multi_line=True, timeout=8000)

    return attempt


def _escaped(text: str) -> str:
    import html

    return html.escape(text, quote=True)
