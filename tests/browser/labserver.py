"""A JupyterLab of our own on a loopback port, and notebooks opened in a system Chromium."""

import json
import os
import secrets
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[2]
SETTINGS = {
    "apputils-extension/notification": {"checkForUpdates": False, "doNotDisturbMode": True,
                                        "fetchNews": "false"},
    "docmanager-extension/plugin": {"autosave": False},
    "notebook-extension/tracker": {"windowingMode": "none"},
}


def chromium():
    """Path of the browser: the environment's CHROMIUM, or one of the usual names."""
    names = [os.environ.get("CHROMIUM", ""), "chromium", "chromium-browser", "google-chrome"]
    found = next(filter(None, map(shutil.which, filter(None, names))), None)
    assert found, "no Chromium here: install it, or name it with CHROMIUM=/path/to/chromium"
    return found


@contextmanager
def lab(folder):
    """Serve copies of the notebooks in `folder`, with own settings; gives (address, token)."""
    for p, content in SETTINGS.items():
        file = folder / "settings" / "@jupyterlab" / f"{p}.jupyterlab-settings"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(content))
    shutil.copytree(ROOT / "notebooks", folder / "root" / "notebooks",
                    ignore=shutil.ignore_patterns(".*"))
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        port = s.getsockname()[1]
    token, address = secrets.token_hex(16), f"http://127.0.0.1:{port}"
    env = dict(os.environ, PYTHONPATH=str(ROOT), PYDEVD_DISABLE_FILE_VALIDATION="1",
               IPYTHONDIR=str(folder / "ipython"),
               JUPYTERLAB_SETTINGS_DIR=str(folder / "settings"),
               JUPYTERLAB_WORKSPACES_DIR=str(folder / "workspaces"))
    env |= {f"JUPYTER_{what}_DIR": str(folder / what) for what in ("CONFIG", "RUNTIME", "DATA")}
    command = [sys.executable, "-m", "jupyterlab", "--no-browser", "--allow-root",
               "--ServerApp.ip=127.0.0.1",
               f"--ServerApp.port={port}", "--ServerApp.port_retries=0",
               f"--IdentityProvider.token={token}",
               f"--ServerApp.root_dir={folder / 'root'}", "--LabApp.expose_app_in_browser=True",
               "--LabApp.check_for_updates_class=jupyterlab.NeverCheckForUpdate",
               "--LabApp.news_url=None"]
    with (folder / "log").open("w") as log:
        server = subprocess.Popen(command, env=env, stdin=subprocess.DEVNULL, stdout=log,
                                  stderr=subprocess.STDOUT)
    try:
        for _ in range(1200):
            assert server.poll() is None, (folder / "log").read_text()
            try:
                urllib.request.urlopen(f"{address}/api/status?token={token}", timeout=5).close()
                break
            except OSError:
                time.sleep(0.1)
        yield address, token
    finally:
        server.terminate()  # it ends its kernels first
        try:
            server.wait(30)
        except subprocess.TimeoutExpired:
            server.kill()


class Notebook:
    """A notebook in a page of the browser."""

    READY = """() => { const widget = window.jupyterapp?.shell.currentWidget;
                       const kernel = widget?.sessionContext?.session?.kernel;
                       return kernel && ['idle', 'busy'].includes(kernel.status) }"""
    RUN = """async () => {
      const notebook = window.jupyterapp.shell.currentWidget;
      await notebook.context.ready; await notebook.sessionContext.ready;
      await window.jupyterapp.commands.execute('notebook:run-all-cells');
      return notebook.content.model.sharedModel.cells.flatMap(
        c => (c.outputs || []).filter(o => o.output_type === 'error')
                              .map(o => o.ename + ': ' + o.evalue)) }"""
    ASK = """async code => {
      const kernel = window.jupyterapp.shell.currentWidget.sessionContext.session.kernel;
      let said = '', error = '';
      const future = kernel.requestExecute({ code, store_history: false });
      future.onIOPub = ({ header, content }) => {
        if (header.msg_type === 'stream') said += content.text;
        if (header.msg_type === 'error') error = content.ename + ': ' + content.evalue };
      await future.done; if (error) throw new Error(error); return said }"""
    SAVE = "async () => { await window.jupyterapp.commands.execute('docmanager:save') }"
    END = "async () => { await window.jupyterapp.shell.currentWidget.sessionContext.shutdown() }"
    CURVE = """key => { const plot = document.querySelector('.js-plotly-plot');
                        const n = plot?.data?.findIndex(t => t.meta === key);
                        return n >= 0 && { y: Array.from(plot.data[n].y),
                                           uid: plot._fullData[n].uid } }"""
    # a page that took more than 2 s; nothing of ours waits for it
    LATE = "[anywidget] Failed to initialize model."
    PATH = """uid => document.querySelector(`.scatterlayer .trace${uid} path.js-line`)
                             ?.getAttribute('d')"""

    def __init__(self, page, server, path):
        self.page, self.errors, self.late = page, [], []
        page.on("pageerror",
                lambda e: (self.late if str(e) == self.LATE else self.errors).append(str(e)))
        page.set_default_timeout(120_000)
        address, token = server
        page.goto(f"{address}/lab/tree/{path}?token={token}&reset")
        self.ready()

    def ready(self):
        """Wait until the notebook and its kernel are there."""
        self.page.wait_for_selector(".jp-NotebookPanel .jp-Cell")
        self.page.wait_for_function(self.READY)

    def run(self):
        """Run all cells; the errors they end with."""
        return self.page.evaluate(self.RUN)

    def ask(self, code):
        """What `code` prints in the kernel."""
        return self.page.evaluate(self.ASK, code).strip()

    def curve(self, key):
        """(values, SVG path) of a curve of the live plot, as the page has them."""
        self.page.wait_for_function(self.CURVE, arg=key)
        found = self.page.evaluate(self.CURVE, key)
        return found["y"], self.page.evaluate(self.PATH, found["uid"])

    def said(self, words):
        """Wait until the mask says this; all that it says."""
        self.page.wait_for_function(
            "words => document.querySelector('.smcaero-status')?.textContent.includes(words)",
            arg=words)
        return self.page.locator(".smcaero-status").text_content()

    def slider(self, name):
        """Handle of a slider, with the focus."""
        handle = self.page.locator(f".smcaero-set-{name} [role=slider]")
        handle.scroll_into_view_if_needed()
        handle.focus()
        return handle

    def entry(self, name):
        """Text entry of a parameter."""
        return self.page.locator(f".smcaero-set-{name} input[type=text]")

    def close(self):
        """End the kernel and close the page."""
        self.page.evaluate(self.END)
        self.page.close()


def write_notebook(file, *cells):
    """Write a notebook of code cells."""
    import nbformat.v4 as nf

    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    nb = nf.new_notebook(cells=[nf.new_code_cell(c) for c in cells],
                         metadata={"kernelspec": kernel})
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(nf.writes(nb))
