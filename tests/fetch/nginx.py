# SPDX-License-Identifier: Apache-2.0
"""nginx on a free local port, serving a folder."""
import os
import socket
import subprocess
import time


class Nginx:
    """`limit`: bytes per second of each connection, as in nginx's limit_rate; 0: unlimited.
    `precompressed`: sends FILE.gz in place of FILE to browsers. `settings`: more of the server, such as
    locations."""

    START_TIMEOUT = 60  # seconds; a busy machine starts slowly

    def __init__(self, folder, limit="0", precompressed=False, settings=""):
        self.folder, self.limit = folder, limit
        self.settings = settings + ("gzip_static on;" if precompressed else "")
        self.config = folder + "/nginx.conf"
        self.pid, self.log = folder + "/pid", folder + "/error.log"

    def __enter__(self):
        end = time.monotonic() + self.START_TIMEOUT
        while time.monotonic() < end:
            self._start()
            # nginx writes its pid file once it has the port, and exits if the port is taken.
            while self.server.poll() is None and time.monotonic() < end:
                if self._is_serving():
                    return self
                time.sleep(0.02)
        self.__exit__()
        with open(self.log, encoding="utf-8") as log:
            raise RuntimeError("nginx does not serve: " + log.read())

    def _start(self):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.url = f"http://127.0.0.1:{self.port}/scene.stgs"
        folder = self.folder
        config = f"""
            worker_processes 1; daemon off; pid {self.pid}; error_log {self.log};
            events {{}}
            http {{ types {{ text/html html; text/javascript js; application/wasm wasm;
              image/svg+xml svg; }}
              access_log off; client_body_temp_path {folder}/1; proxy_temp_path {folder}/2;
              fastcgi_temp_path {folder}/3; uwsgi_temp_path {folder}/4;
              scgi_temp_path {folder}/5;
              server {{ listen 127.0.0.1:{self.port}; root {folder}; limit_rate {self.limit};
                {self.settings} }} }}"""
        with open(self.config, "w", encoding="ascii") as file:
            file.write(config if os.getuid() else "user root;" + config)
        self.server = subprocess.Popen(["nginx", "-e", self.log, "-c", self.config],
                                       stderr=subprocess.DEVNULL)

    def _is_serving(self):
        try:
            with open(self.pid, encoding="ascii") as file:
                return file.read().strip() == str(self.server.pid)
        except FileNotFoundError:
            return False

    def __exit__(self, *_):
        self.server.terminate()
        self.server.wait()
