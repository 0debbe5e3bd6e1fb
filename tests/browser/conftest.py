"""One JupyterLab and one browser for all tests here; a fresh page for each."""

import pytest
from labserver import Notebook, chromium, lab, write_notebook


@pytest.fixture(scope="session")
def server(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab")
    with lab(folder) as (address, token):
        yield address, token, folder / "root"


@pytest.fixture(scope="session")
def browser():
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        b = playwright.chromium.launch(executable_path=chromium(),
                                       args=["--no-sandbox", "--disable-gpu"])
        yield b
        b.close()


@pytest.fixture(scope="module")
def notebook(server, browser, request):
    """Open a notebook, ``notebook("notebooks/x.ipynb")``, or make one, ``notebook(cell, cell)``.

    `script` runs in its page before anything else.
    """
    address, token, root = server
    opened = []

    def open_notebook(*cells, script=""):
        path = cells[0]
        if not path.endswith(".ipynb"):
            path = f"{request.module.__name__}_{len(opened)}.ipynb"
            write_notebook(root / path, *cells)
        page = browser.new_page(viewport=dict(width=1400, height=1000), reduced_motion="reduce")
        page.add_init_script(script)
        opened.append(Notebook(page, (address, token), path))
        return opened[-1]

    yield open_notebook
    for nb in opened:
        if not nb.page.is_closed():
            nb.close()
