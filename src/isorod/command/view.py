"""``isorod view``: an interactive view of results in a browser on this machine."""

import os
import secrets
import sys
import webbrowser
from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any

import numpy as np

from isorod.command import drawing
from isorod.command.parser import Parser
from isorod.command.viewed import Place, View
from isorod.errors import InputError
from isorod.output import picture, reading, vtk

# Width of the panel beside the picture, and of the smallest picture, pixels.
_PANEL, _SMALLEST = 300, 200

_STYLE = f"""
body {{margin: 0; font: 14px system-ui, sans-serif; color: #222}}
main {{display: flex; height: 100vh}}
.panel {{width: {_PANEL}px; box-sizing: border-box; padding: 12px 16px; background: #eee; flex: none; overflow: auto}}
.picture {{flex: 1; min-width: 0; height: 100vh}}
h1 {{font-size: 17px; margin: 0 0 12px}}
label {{display: block; margin: 12px 0 4px; color: #555}}
input, select {{width: 100%; box-sizing: border-box; font: inherit; padding: 3px}}
table {{width: 100%; border-collapse: collapse; margin-top: 8px}}
td {{padding: 2px 0; border-bottom: 1px solid #ddd}}
td:last-child {{text-align: right; font-variant-numeric: tabular-nums}}
.three {{display: flex; gap: 6px}}
#body {{width: 20%}}
#u {{width: 35%}}
.error {{color: #b00020}}
small {{color: #555}}
"""


def main(ours: Sequence[str], theirs: Sequence[str] = ()) -> int:
    """Show a result until Ctrl-C; return the exit code."""
    args = parser().known(ours)
    if not 0 <= args.port < 65536:
        raise InputError(f"--port: got {args.port}, need 0 to 65535")
    result = reading.find(args.place, args.run)
    if not result.steps:
        raise InputError(f"{args.place}: this run of {result.name} wrote no fields; isorod plot --curve draws curves")
    for name in ("trame", "trame_vtk"):
        if find_spec(name) is None:
            raise InputError(f"view needs {name}, which is not installed: pip install 'isorod[view]'")
    vtk.require("results")
    picture.without_display()
    with picture.stage(picture.SIZE) as plotter:
        _serve(View(result, plotter), plotter, args.port, args.browser)
    return 0


def parser() -> Parser:
    """Return the parser of the command's options."""
    result = drawing.of_results("view", ".vtu or .pvd")
    result.add_argument("--port", type=int, default=0, metavar="int", help="port of this machine (a free one)")
    result.add_argument("--no-browser", action="store_false", dest="browser", help="print the address alone")
    return result


def _serve(view: View, plotter: Any, port: int, browser: bool) -> None:
    """Serve the page on this machine alone, to whoever has the key, until Ctrl-C."""
    key = secrets.token_urlsafe(16)
    os.environ["WSLINK_READY_MSG"] = ""
    before = sys.argv
    # The server takes its arguments from there alone.
    sys.argv = [before[0], "--authKey", key]
    try:
        from trame.app import get_server

        server = get_server(f"isorod-{key}")
        _page(server, view, plotter)

        def ready(**_: Any) -> None:
            address = f"http://127.0.0.1:{server.port}/?secret={key}"
            print(f"{address}   (Ctrl-C ends)", flush=True)
            if browser and (sys.platform == "darwin" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
                webbrowser.open(address)

        server.controller.on_server_ready.add(ready)
        options: dict[str, Any] = {"open_browser": False, "show_connection_info": False, "disable_logging": True}
        server.start(port=port, host="127.0.0.1", timeout=0, backend="aiohttp", **options)
    except OSError as problem:
        raise InputError(f"--port: got {port}, which cannot be used ({problem.strerror}); name another") from None
    finally:
        sys.argv = before


def _page(server: Any, view: View, plotter: Any) -> None:
    """Make the page: inputs and values at the left, the picture beside them."""
    from trame.ui.html import DivLayout
    from trame.widgets import client, html
    from trame.widgets import vtk as widgets

    state, control = server.state, server.controller
    state.trame__title = f"isorod: {view.result.title}"
    names = [one.name for one in view.states]
    first = next((k for k, one in enumerate(view.states) if one.mode), len(names) - 1)
    state.update({"names": names, "step": first, "scale": "", "body": 0, "u": "", "xi": "", "error": ""})
    fields = view.fields(view.states[first])
    state.field = next((one for one in ("von_mises", "displacement") if one in fields), next(iter(fields)))

    # The place as last written into the page by the server.
    shown: list[Any] = []

    def draw(**_: Any) -> None:
        now = view.states[int(state.step)]
        fields = view.fields(now)
        state.fields = [{"key": key, "name": one.name} for key, one in fields.items()]
        if state.field not in fields:
            state.field = "displacement" if "displacement" in fields else next(iter(fields))
        state.error = ""
        try:
            state.used = float(state.scale) if str(state.scale).strip() else view.scale(now)
            if not np.isfinite(state.used):
                raise ValueError
        except ValueError:
            state.used, state.error = view.scale(now), f"displacements times {state.scale!r:.20}: need a number"
        view.draw(now, fields[state.field], state.used)
        state.note, state.numbers, state.rest = view.note(now), view.numbers(now), view.at_rest(now)
        place = view.place or Place(0, 0)
        state.body, state.u = place.body, "" if place.u is None else f"{place.u:.6g}"
        state.xi = ", ".join(f"{x:.4g}" for x in place.xi)
        shown[:] = state.body, state.u, state.xi
        control.update()

    def go(**_: Any) -> None:
        if shown == [state.body, state.u, state.xi] or not str(state.u).strip():
            return
        try:
            first, second = (float(word) for word in (str(state.xi).strip() or "0, 0").split(","))
            view.go(view.states[int(state.step)], int(state.body), float(state.u), (first, second))
        except ValueError:
            state.error = "need a body's number, a number u, and two xi: 0; 0.5; 1, 0"
            return
        except InputError as problem:
            state.error = str(problem)
            return
        draw()

    # Where a button went down: only where it comes up again it was a click, else the view was turned.
    style, interactor = plotter.iren.interactor.GetInteractorStyle(), plotter.iren.interactor
    pressed: list[tuple[int, int] | None] = [None]

    def down(*_: Any) -> None:
        rotates = style.GetState() == 1
        pressed[0] = interactor.GetEventPosition() if rotates else None

    def up(*_: Any) -> None:
        if pressed[0] is not None and pressed[0] == interactor.GetEventPosition():
            view.pick(view.states[int(state.step)], *pressed[0])
            with state:
                draw()

    def fit(*_: Any) -> None:
        # The page is small before it has its size.
        if min(plotter.window_size) >= _SMALLEST:
            camera = plotter.camera
            view.fit(np.subtract(camera.position, camera.focal_point), np.asarray(camera.up))
            draw()

    style.AddObserver("StartInteractionEvent", down)
    style.AddObserver("EndInteractionEvent", up)
    plotter.render_window.AddObserver("WindowResizeEvent", fit)
    with DivLayout(server):
        client.Style(_STYLE)
        with html.Main():
            with html.Div(classes="panel"):
                html.H1(view.result.title)
                if len(names) > 1:
                    html.Label("{{ names[step] }}")
                    html.Input(type="range", min=0, max=len(names) - 1, id="step", raw_attrs=['v-model.number="step"'])
                html.Label("Colours")
                with html.Select(v_model="field", id="field"):
                    html.Option("{{ one.name }}", v_for="one in fields", value=("one.key",), key="one.key")
                html.Label("Displacements times {{ Number(used.toPrecision(3)) }}")
                html.Input(v_model_lazy="scale", id="scale", placeholder="automatic")
                html.Label("Click on a rod, or type body, u and xi")
                with html.Div(classes="three"):
                    for name in ("body", "u", "xi"):
                        html.Input(id=name, placeholder=name, raw_attrs=[f'v-model.lazy="{name}"'])
                html.Div("{{ error }}", v_if="error", classes="error", id="error")
                with html.Table(id="numbers"):
                    with html.Tr(v_for="one in numbers", key="one[0]"):
                        html.Td("{{ one[0] }}")
                        html.Td("{{ one[1] }}")
                html.Small("at rest at {{ rest }}", v_if="rest")
                html.P("{{ note }}", v_if="note")
            with html.Div(classes="picture"):
                control.update = widgets.VtkRemoteView(plotter.render_window, interactive_ratio=1).update
    state.change("step", "field", "scale")(draw)
    state.change("body", "u", "xi")(go)
    picture.add_axes(plotter, plotter.window_size)
    draw()
    view.fit(picture.VIEW)
