"""The page of a robot in a notebook: it runs in a frame, without a network, and reaches nothing outside of it."""

import pytest
from lxml import html

from robot_dynamics import Dynamics, InvalidInputError, load_robot, notebook_view
from robot_dynamics.model.loading import read_robot

pytest.importorskip("viser")

WAIT = 30_000  # [ms]
HOSTILE = '"></iframe><script>document.title="taken"</script>'
TABLE = f"""
robot: {HOSTILE!r}
joints:
  - {{joint: {HOSTILE!r}, link: pole, mdh: {{alpha: 0, d: 0.3}}, mass: 1, centre_of_mass: [0.4, 0, 0]}}
"""


@pytest.mark.slow
def test_page_runs_in_a_frame_without_network(browser, tmp_path):
    view = notebook_view(read_robot(TABLE, source="a table"), height=300)
    file = tmp_path / "notebook.html"
    text = f"<!doctype html><meta charset='utf-8'><title>notebook</title>{view._repr_html_()}"
    file.write_text(text, encoding="utf-8")
    assert len(text) < 3e6
    (frame,) = html.fromstring(view._repr_html_()).iter("iframe")
    assert frame.get("sandbox") == "allow-scripts" and frame.get("title") == HOSTILE
    context = browser.new_context(offline=True, viewport={"width": 640, "height": 480})
    try:
        page, errors, requests = context.new_page(), [], []
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("request", lambda request: requests.append(request.url))
        page.goto(f"file://{file}")
        page.frame_locator("iframe").locator("canvas").first.wait_for(timeout=WAIT)
        assert page.title() == "notebook" and errors == []
        assert [url for url in requests if not url.startswith(("file:", "data:", "blob:", "about:"))] == []
    finally:
        context.close()


@pytest.mark.slow
def test_dynamics_are_shown_as_their_robot():
    view = notebook_view(Dynamics(load_robot("rx90"), compiled=False))
    assert view.title == "rx90" and repr(view).startswith("NotebookView('rx90', ")


def test_other_objects_are_refused():
    with pytest.raises(InvalidInputError, match="takes a Robot, as load_robot returns it, not 'panda'"):
        notebook_view("panda")


@pytest.mark.slow
def test_nothing_is_printed_in_a_notebook(monkeypatch):
    """In a notebook rich, by which viser prints a banner, publishes HTML instead of writing to stdout."""
    import rich
    from rich.console import Console

    published = []
    monkeypatch.setattr("rich.jupyter.display", lambda segments, text: published.append(text))
    monkeypatch.setattr(rich, "_console", Console(force_jupyter=True))
    notebook_view(load_robot("rx90"))
    assert published == []
    rich.print("shown again")
    assert "shown again" in "".join(published)
