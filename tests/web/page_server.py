# SPDX-License-Identifier: Apache-2.0
"""Serves a page to headless Chromium and collects its posts."""
import http.server
import os
import threading
import time

from browser import Browser

# For WebGPU without a GPU. The page needs a secure context, such as this server.
WEBGPU_FLAGS = ["--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader",
                "--enable-features=Vulkan", "--use-vulkan=swiftshader"]
TYPES = {".html": "text/html", ".js": "text/javascript", ".mjs": "text/javascript",
         ".json": "application/json"}


class PageServer:
    """Serves the files of a folder. A page posts results to /NAME, and at last to /done."""

    def __init__(self, folder):
        self.folder = folder
        self.posts = {}
        self.done = threading.Event()
        server = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def log_message(self, *args):
                pass

            def do_GET(self):
                name = self.path.split("?")[0].lstrip("/")
                path = os.path.join(server.folder, name)
                if "/" in name or not os.path.isfile(path):
                    self.send_error(404)
                    return
                with open(path, "rb") as file:
                    data = file.read()
                self.send_response(200)
                kind = TYPES.get(os.path.splitext(name)[1], "application/octet-stream")
                self.send_header("Content-Type", kind)
                self.send_header("Content-Length", str(len(data)))
                self.end_headers()
                self.wfile.write(data)

            def do_POST(self):
                body = self.rfile.read(int(self.headers["Content-Length"]))
                name = self.path.lstrip("/")
                if name == "done":
                    server.posts["done"] = body
                    server.done.set()
                else:
                    server.posts[name] = body
                self.send_response(204)
                self.end_headers()

        self.http = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.thread = threading.Thread(target=self.http.serve_forever, daemon=True)
        self.thread.start()

    def run(self, page, timeout, flags=()):
        """Opens a page in Chromium and returns its posts, once it has posted to /done. `flags`: more options of
        Chromium. Raises TimeoutError."""
        browser = Browser(flags)
        try:
            browser.open(f"http://127.0.0.1:{self.http.server_address[1]}/{page}")
            end = time.monotonic() + timeout
            while not self.done.wait(0.5):
                if browser.process.poll() is not None:
                    raise TimeoutError("Chromium ended")
                if time.monotonic() > end:
                    raise TimeoutError(f"no result after {timeout} s; got {sorted(self.posts)}")
            return self.posts
        finally:
            browser.close()

    def close(self):
        self.http.shutdown()
        self.http.server_close()
        self.thread.join()
